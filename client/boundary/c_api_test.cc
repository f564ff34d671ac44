// cairn.h: structs of other versions, errors, handles. Answers are compared by public_localizer_test.cc.
#include <cstring>
#include <limits>
#include <vector>

#include "cairn.h"
#include "client/boundary/c_structs.h"
#include "client/boundary/testing_map_file.h"
#include "client/conformance/conformance_map.h"

namespace cairn::conformance {
namespace {

template <class Struct>
Struct Sized() {
  Struct result{};
  result.struct_size = sizeof(result);
  return result;
}

class CApi : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(WriteConformanceMap(file_.path).ok());
    ASSERT_EQ(cairn_map_open(file_.path.c_str(), nullptr, nullptr, &map_, &error_), CAIRN_OK) << error_.message;
    ASSERT_EQ(cairn_localizer_new(map_, &localizer_, &error_), CAIRN_OK) << error_.message;
    ASSERT_EQ(cairn_map_get_camera(map_, 0, &camera_, &error_), CAIRN_OK) << error_.message;
    pixels_ = TheConformanceMap().room.Render(TheConformanceMap().pinhole, LookInRoom({0.2, 0.0, -1.4}, 0.05));
    image_.data = pixels_.data;
    image_.width_px = pixels_.cols;
    image_.height_px = pixels_.rows;
  }
  void TearDown() override {
    cairn_localizer_free(localizer_);
    cairn_map_close(map_);
  }
  cairn_code Localize(const cairn_call_options* call = nullptr) {
    return cairn_localizer_localize(localizer_, &query_, call, &answer_, &error_);
  }

  const TestingMapFile file_{"c_api"};
  cv::Mat pixels_;
  cairn_map* map_ = nullptr;
  cairn_localizer* localizer_ = nullptr;
  cairn_error error_ = Sized<cairn_error>();
  cairn_camera camera_ = Sized<cairn_camera>();
  cairn_image image_ = Sized<cairn_image>();
  cairn_localize_query query_ = {sizeof(query_), &image_, &camera_, 0, nullptr};
  cairn_localize_answer answer_ = Sized<cairn_localize_answer>();
};

TEST_F(CApi, AnswersAndSaysWhatTheMapIs) {
  ASSERT_EQ(Localize(), CAIRN_OK) << error_.message;
  EXPECT_EQ(answer_.struct_size, sizeof(answer_));
  EXPECT_EQ(answer_.localized, 1);
  EXPECT_STREQ(cairn_localize_stage_name(answer_.stage), "done");
  EXPECT_STREQ(answer_.map_id, TheConformanceMap().snapshot->info().id.c_str());
  EXPECT_NEAR(answer_.map_from_camera.translation[2], -1.4, 0.02);
  EXPECT_EQ(answer_.world_is_metric, 1);
  EXPECT_EQ(answer_.world_per_map, 2.0);
  EXPECT_GT(answer_.position_sigma, 0.0);
  EXPECT_LT(answer_.position_sigma, 0.05);
  EXPECT_STREQ(error_.message, "");

  auto info = Sized<cairn_map_info>();
  ASSERT_EQ(cairn_map_get_info(map_, &info, &error_), CAIRN_OK) << error_.message;
  EXPECT_STREQ(info.name, "conformance");
  EXPECT_EQ(info.cameras, 1);
  EXPECT_EQ(info.components, 1);
  EXPECT_EQ(info.aligned, 1);
  auto component = Sized<cairn_component>();
  ASSERT_EQ(cairn_map_get_component(map_, 0, &component, &error_), CAIRN_OK) << error_.message;
  EXPECT_EQ(component.id, answer_.component);
  EXPECT_EQ(component.aligned, 1);
  EXPECT_EQ(component.keyframes, 10);
  EXPECT_EQ(component.scale, 2.0);
  EXPECT_EQ(component.world_from_component.translation[0], 10.0);
  EXPECT_EQ(cairn_map_get_component(map_, 1, &component, &error_), CAIRN_OUT_OF_RANGE);
  std::int32_t changed = 9;
  EXPECT_EQ(cairn_map_refresh(map_, nullptr, &changed, &error_), CAIRN_OK);
  EXPECT_EQ(changed, 0);
}

TEST_F(CApi, ErrorsHaveACodeAndAMessage) {
  cairn_map* none = nullptr;
  EXPECT_EQ(cairn_map_open("/no/such/map.cairn", nullptr, nullptr, &none, &error_), CAIRN_NOT_FOUND);
  EXPECT_EQ(error_.code, CAIRN_NOT_FOUND);
  EXPECT_THAT(error_.message, testing::HasSubstr("/no/such/map.cairn"));
  EXPECT_EQ(none, nullptr);
  EXPECT_EQ(cairn_map_open("/no/such/map.cairn", nullptr, nullptr, &none, nullptr), CAIRN_NOT_FOUND);
  EXPECT_STREQ(cairn_code_name(CAIRN_NOT_FOUND), "NOT_FOUND");
  EXPECT_STREQ(cairn_code_name(-4), "UNKNOWN");
  EXPECT_EQ(cairn_map_get_camera(map_, 1, &camera_, &error_), CAIRN_OUT_OF_RANGE);
  EXPECT_EQ(cairn_map_get_camera(map_, -1, &camera_, &error_), CAIRN_OUT_OF_RANGE);

  image_.width_px = 479;
  answer_.components = 123;
  EXPECT_EQ(Localize(), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(answer_.components, 123) << "an error changes no output";
  EXPECT_THAT(error_.message, testing::HasSubstr("479"));
  image_.width_px = 480;
  camera_.num_distortion = 9;
  EXPECT_EQ(Localize(), CAIRN_INVALID_ARGUMENT);
  camera_.num_distortion = 0;
  camera_.model = 17;
  EXPECT_EQ(Localize(), CAIRN_INVALID_ARGUMENT);
}

TEST_F(CApi, NullIsAnErrorOrNothing) {
  EXPECT_EQ(cairn_map_open(nullptr, nullptr, nullptr, &map_, &error_), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_map_open("x", nullptr, nullptr, nullptr, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_map_get_info(nullptr, nullptr, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_map_get_info(map_, nullptr, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_map_get_camera(nullptr, 0, &camera_, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_map_refresh(nullptr, nullptr, nullptr, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_map_refresh(map_, nullptr, nullptr, nullptr), CAIRN_OK);
  EXPECT_EQ(cairn_localizer_new(nullptr, &localizer_, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_localizer_new(map_, nullptr, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_localizer_localize(nullptr, &query_, nullptr, &answer_, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_localizer_localize(localizer_, nullptr, nullptr, &answer_, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_localizer_localize(localizer_, &query_, nullptr, nullptr, nullptr), CAIRN_INVALID_ARGUMENT);
  query_.image = nullptr;
  EXPECT_EQ(Localize(), CAIRN_INVALID_ARGUMENT);
  query_.image = &image_;
  query_.camera = nullptr;
  EXPECT_EQ(Localize(), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_tracker_new(nullptr, &camera_, nullptr, nullptr, nullptr, nullptr), CAIRN_INVALID_ARGUMENT);
  EXPECT_EQ(cairn_tracker_track(nullptr, &image_, 0, nullptr, nullptr, nullptr), CAIRN_INVALID_ARGUMENT);
  cairn_map_close(nullptr);
  cairn_localizer_free(nullptr);
  cairn_tracker_free(nullptr);
  cairn_cancellation_free(nullptr);
  cairn_cancellation_cancel(nullptr);
}

TEST_F(CApi, StructsOfOtherVersions) {
  // Of a program that did not set it.
  answer_.struct_size = 0;
  EXPECT_EQ(Localize(), CAIRN_INVALID_ARGUMENT);
  EXPECT_THAT(error_.message, testing::HasSubstr("set it to sizeof"));
  answer_.struct_size = sizeof(answer_);
  image_.struct_size = sizeof(image_) - 8;
  EXPECT_EQ(Localize(), CAIRN_INVALID_ARGUMENT);
  image_.struct_size = sizeof(image_);

  // Of a later version: what it adds is zero unless used, and comes back as zero.
  struct {
    cairn_image image;
    std::int64_t later;
  } image = {image_, 0};
  image.image.struct_size = sizeof(image);
  query_.image = &image.image;
  struct {
    cairn_localize_answer answer;
    std::int64_t later[2];
  } answer = {answer_, {-1, -1}};
  answer.answer.struct_size = sizeof(answer) - sizeof(std::int64_t);
  const auto localize = [&] { return cairn_localizer_localize(localizer_, &query_, nullptr, &answer.answer, &error_); };
  ASSERT_EQ(localize(), CAIRN_OK) << error_.message;
  EXPECT_EQ(answer.answer.localized, 1);
  EXPECT_EQ(answer.later[0], 0);
  EXPECT_EQ(answer.later[1], -1) << "beyond what the caller said it has";
  image.later = 5;
  EXPECT_EQ(localize(), CAIRN_INVALID_ARGUMENT);
  EXPECT_THAT(error_.message, testing::HasSubstr("does not know"));
}

TEST_F(CApi, TimeoutAndCancellation) {
  auto call = Sized<cairn_call_options>();
  EXPECT_EQ(Localize(&call), CAIRN_OK);
  call.timeout_ns = std::numeric_limits<std::int64_t>::max();
  EXPECT_EQ(Localize(&call), CAIRN_OK);
  call.timeout_ns = 1;
  EXPECT_EQ(Localize(&call), CAIRN_DEADLINE_EXCEEDED);
  call.timeout_ns = -1;
  EXPECT_EQ(Localize(&call), CAIRN_INVALID_ARGUMENT);
  call.timeout_ns = 0;
  cairn_cancellation* cancellation = cairn_cancellation_new();
  call.cancellation = cancellation;
  EXPECT_EQ(Localize(&call), CAIRN_OK);
  cairn_cancellation_cancel(cancellation);
  EXPECT_EQ(Localize(&call), CAIRN_CANCELLED);
  cairn_cancellation_free(cancellation);
}

TEST_F(CApi, OptionsReachTheMap) {
  auto options = Sized<cairn_map_options>();
  options.num_features = -5;
  cairn_map* other = nullptr;
  EXPECT_EQ(cairn_map_open(file_.path.c_str(), &options, nullptr, &other, &error_), CAIRN_INVALID_ARGUMENT);
  options.num_features = 0;
  options.reserved = 1;
  EXPECT_EQ(cairn_map_open(file_.path.c_str(), &options, nullptr, &other, &error_), CAIRN_INVALID_ARGUMENT);
  auto track = Sized<cairn_tracker_options>();
  track.mode = 12;
  cairn_tracker* tracker = nullptr;
  EXPECT_EQ(cairn_tracker_new(map_, &camera_, &track, nullptr, &tracker, &error_), CAIRN_INVALID_ARGUMENT);
}

TEST(CStructs, StringsAreCutBetweenCharacters) {
  char to[6];
  client::WriteString("abc", to, sizeof(to));
  EXPECT_STREQ(to, "abc");
  client::WriteString("abcdefgh", to, sizeof(to));
  EXPECT_STREQ(to, "abcde");
  client::WriteString("abcd\xc3\xa4", to, sizeof(to));  // an umlaut of two bytes
  EXPECT_STREQ(to, "abcd");
  client::WriteString("abc\xc3\xa4", to, sizeof(to));
  EXPECT_STREQ(to, "abc\xc3\xa4");
}

TEST(CStructs, ZeroIsTheDefaultOfATracker) {
  auto options = Sized<cairn_tracker_options>();
  const auto usual = client::ReadTrackerOptions(&options);
  ASSERT_TRUE(usual.ok()) << usual.status();
  const v0::TrackerOptions expected;
  EXPECT_EQ(usual->mode, expected.mode);
  EXPECT_EQ(usual->deterministic, expected.deterministic);
  EXPECT_EQ(usual->relocalize_in_call, expected.relocalize_in_call);
  EXPECT_EQ(usual->wait_for_matches, expected.wait_for_matches);
  options.relocalize_beside_call = options.wait_for_matches = options.deterministic = 1;
  options.mode = CAIRN_TRACK_FEATURES;
  const auto other = client::ReadTrackerOptions(&options);
  ASSERT_TRUE(other.ok()) << other.status();
  EXPECT_EQ(other->mode, v0::TrackMode::kFeatures);
  EXPECT_TRUE(other->deterministic);
  EXPECT_FALSE(other->relocalize_in_call);
  EXPECT_TRUE(other->wait_for_matches);
}

TEST(CStructs, TheTrackAnswerLosesNothing) {
  v0::TrackAnswer answer;
  answer.time_ns = 1;
  answer.state = v0::TrackState::kCarried;
  answer.reason = "beyond the map";
  answer.map_from_camera.translation = {1.0, 2.0, 3.0};
  answer.component = 4;
  answer.world_from_camera.rotation_xyzw = {1.0, 0.0, 0.0, 0.0};
  answer.world_per_map = 5.0;
  answer.world_is_metric = true;
  answer.covariance[0] = 6.0;
  answer.map_id = "id";
  answer.note = "the map was removed";
  answer.revision = 7;
  answer.matched_ns = 8;
  answer.inliers = 9;
  answer.track_ms = 10.0;
  answer.connected = false;
  answer.map_age_s = 11.0;
  answer.focal_factor = 0.8;
  const cairn_track_answer c = client::ToC(answer);
  EXPECT_EQ(c.time_ns, 1);
  EXPECT_EQ(c.state, CAIRN_CARRIED);
  EXPECT_STREQ(cairn_track_state_name(c.state), "carried");
  EXPECT_STREQ(c.reason, "beyond the map");
  EXPECT_EQ(c.map_from_camera.translation[2], 3.0);
  EXPECT_EQ(c.component, 4u);
  EXPECT_EQ(c.world_from_camera.rotation_xyzw[0], 1.0);
  EXPECT_EQ(c.world_per_map, 5.0);
  EXPECT_EQ(c.world_is_metric, 1);
  EXPECT_EQ(c.covariance[0], 6.0);
  EXPECT_NEAR(c.position_sigma, std::sqrt(6.0), 1e-12);
  EXPECT_STREQ(c.map_id, "id");
  EXPECT_STREQ(c.note, "the map was removed");
  EXPECT_EQ(c.revision, 7u);
  EXPECT_EQ(c.matched_ns, 8);
  EXPECT_EQ(c.inliers, 9);
  EXPECT_EQ(c.track_ms, 10.0);
  EXPECT_EQ(c.connected, 0);
  EXPECT_EQ(c.map_age_s, 11.0);
  EXPECT_EQ(c.focal_factor, 0.8);
}

}  // namespace
}  // namespace cairn::conformance
