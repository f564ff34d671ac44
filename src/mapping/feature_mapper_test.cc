#include "mapping/feature_mapper.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>
#include <vector>

#include "geometry/alignment.h"
#include "image/orb_extractor.h"
#include "mapping/testing_room.h"
#include "place/training.h"

namespace cairn::mapping {
namespace {

using testing::CirclePose;
using testing::kRoomPinhole;
using testing::PacketMaker;
using testing::Room;

FeatureMapperOptions SmallOptions() {
  FeatureMapperOptions options;
  options.min_features = 500;
  options.max_features = 700;
  return options;
}

// A mapper over a map that lives in the test.
struct TestRun {
  std::shared_ptr<const map::Snapshot> map;
  SessionId session;
  CameraId camera;
  std::unique_ptr<FeatureMapper> mapper;
  std::vector<KeyframeReport> reports;
  std::vector<SE3> truth;
  int commits = 0;

  explicit TestRun(const FeatureMapperOptions& options = SmallOptions(),
                   std::shared_ptr<const map::Snapshot> start = nullptr,
                   const place::Vocabulary* vocabulary = nullptr) {
    map::MapInfo info;
    info.id = std::string(32, '1');
    if (vocabulary != nullptr) info.vocabulary_hash = vocabulary->hash();
    map = start ? start : map::Snapshot::Empty(info);
    map::Edit edit(map);
    camera = edit.AddCamera({CameraId(), "camera", Camera::FromPinhole(kRoomPinhole), kRoomPinhole});
    map::Session added;
    added.camera = camera;
    session = edit.AddSession(added);
    map = *map->Apply(edit.Finish("session"));
    auto made = FeatureMapper::Create(options, map, session, camera, vocabulary,
                                      [this](map::Delta delta) -> absl::StatusOr<std::shared_ptr<const map::Snapshot>> {
                                        ++commits;
                                        CAIRN_ASSIGN_OR_RETURN(map, map->Apply(delta));
                                        return map;
                                      });
    EXPECT_TRUE(made.ok()) << made.status();
    if (made.ok()) mapper = std::move(*made);
  }

  void Process(const direct::KeyframePacket& packet, const SE3& room_from_camera) {
    const auto report = mapper->Process(packet);
    ASSERT_TRUE(report.ok()) << report.status();
    reports.push_back(*report);
    truth.push_back(room_from_camera);
  }

  // Root mean square of the camera centres after Sim(3) alignment; every keyframe must be located.
  double Error() const {
    std::vector<Vector3d> estimated, expected;
    for (const TrajectoryKeyframe& keyframe : mapper->Trajectory(*map)) {
      EXPECT_TRUE(keyframe.located) << keyframe.direct_keyframe;
      estimated.push_back(keyframe.map_from_camera.translation());
      expected.push_back(truth[static_cast<std::size_t>(keyframe.direct_keyframe)].translation());
    }
    const auto alignment = AlignPoints(expected, estimated);
    EXPECT_TRUE(alignment.ok()) << alignment.status();
    return alignment.ok() ? alignment->rmse : 1e9;
  }

  int Count(FeatureState state) const {
    int count = 0;
    for (const KeyframeReport& report : reports) count += report.state == state ? 1 : 0;
    return count;
  }
};

// Once round the room and a little further, while the direct module's unit doubles: the map must hold its scale, and
// the last keyframes must find the points of the first.
TEST(FeatureMapper, HoldsTheScaleAndFindsOldPointsAgain) {
  const Room room;
  PacketMaker packets(room);
  TestRun run;
  constexpr int kPackets = 48;
  for (int i = 0; i < kPackets; ++i) {
    const SE3 pose = CirclePose(i / 44.0, 0.9);
    run.Process(packets.Make(pose, std::pow(2.0, static_cast<double>(i) / kPackets)), pose);
    if (HasFatalFailure()) return;
  }
  EXPECT_EQ(run.Count(FeatureState::kLost), 0);
  EXPECT_LT(run.Error(), 0.02) << "metres, on a circle of radius 0.9";
  EXPECT_NEAR(run.reports.back().map_per_direct / run.reports[4].map_per_direct, std::pow(2.0, 43.0 / kPackets), 0.15);
  EXPECT_TRUE(run.map->CheckConsistency().ok()) << run.map->CheckConsistency();
  EXPECT_GT(run.map->points().size(), 1000u);
  EXPECT_LT(run.map->keyframes().size(), static_cast<std::size_t>(kPackets)) << "not everything is inserted";

  KeyframeId last;
  run.map->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) { last = keyframe->id; });
  bool joined = false;
  for (const map::CovisibilityEdge& edge : run.map->keyframe(last).covisible) joined |= edge.keyframe.value() <= 4;
  EXPECT_TRUE(joined) << "the circle is not joined";

  const double before = run.Error();
  ASSERT_TRUE(run.mapper->Finish().ok());
  EXPECT_LT(run.Error(), before + 0.002);
  EXPECT_TRUE(run.map->CheckConsistency().ok()) << run.map->CheckConsistency();
}

// Five seconds of blank walls at two keyframes a second: the direct module carries on, the feature module says that it
// is lost, starts anew from direct depths when texture returns, and the new part hangs on the old one.
TEST(FeatureMapper, CarriesOnThroughFiveSecondsWithoutTexture) {
  Room room;
  room.blank_from_rad = 0.5;
  room.blank_to_rad = 2.9;
  PacketMaker packets(room);
  packets.period_ns = 500000000;
  TestRun run;
  for (int i = 0; i < 44; ++i) {
    const SE3 pose = CirclePose(i / 60.0, 0.9);
    run.Process(packets.Make(pose, 1.0), pose);
    if (HasFatalFailure()) return;
  }
  std::int64_t lost_since_ns = -1, longest_ns = 0;
  int restarts = 0, relocations = 0;
  for (const KeyframeReport& report : run.reports) {
    restarts += report.restarted ? 1 : 0;
    relocations += report.relocated ? 1 : 0;
    if (report.state != FeatureState::kLost) {
      lost_since_ns = -1;
      continue;
    }
    if (lost_since_ns < 0) lost_since_ns = report.time_ns;
    longest_ns = std::max(longest_ns, report.time_ns - lost_since_ns);
    EXPECT_FALSE(report.message.empty());
  }
  EXPECT_GE(longest_ns, 5'000'000'000) << "the stretch is too short to show anything";
  EXPECT_EQ(restarts, 1);
  EXPECT_EQ(relocations, 0) << "nothing of the old map is in sight after the stretch";
  EXPECT_EQ(run.reports.back().state, FeatureState::kGood);
  // The part without a map rests on the odometry and on the relative scale known before it.
  EXPECT_LT(run.Error(), 0.12) << "metres on a way of 4.1, the lost keyframes among them";
  int roots = 0;
  run.map->keyframes().ForEach([&](const auto& keyframe) { roots += keyframe->parent ? 0 : 1; });
  EXPECT_EQ(roots, 1) << "the new start is linked to the old map";
  EXPECT_TRUE(run.map->CheckConsistency().ok()) << run.map->CheckConsistency();
}

TEST(FeatureMapper, ExtendsAMapOnceLocatedInIt) {
  const Room room;
  PacketMaker packets(room);
  // A vocabulary of the room itself.
  std::vector<place::ImageDescriptors> images;
  std::vector<direct::KeyframePacket> first;
  for (int i = 0; i < 12; ++i) {
    first.push_back(packets.Make(CirclePose(i / 44.0, 0.9), 1.0));
    images.push_back(image::OrbExtractor(image::OrbParameters{}).Extract(first.back().frame.image, 400)->descriptors);
  }
  const auto vocabulary = place::Train(images, {.branching = 8, .depth = 3, .max_iterations = 4});
  ASSERT_TRUE(vocabulary.ok()) << vocabulary.status();
  TestRun old(SmallOptions(), nullptr, &*vocabulary);
  for (int i = 0; i < 12; ++i) {
    old.Process(first[static_cast<std::size_t>(i)], CirclePose(i / 44.0, 0.9));
    if (HasFatalFailure()) return;
  }
  EXPECT_FALSE(old.map->keyframe(KeyframeId(1)).features->words.empty());

  // Another session, elsewhere at first, in units of its own.
  TestRun extended(SmallOptions(), old.map, &*vocabulary);
  PacketMaker other(room, 7);
  const std::size_t keyframes_before = extended.map->keyframes().size();
  for (int i = 0; i < 14; ++i) {
    const SE3 pose = CirclePose((i - 6) / 44.0, 0.85);
    extended.Process(other.Make(pose, 0.5), pose);
    if (HasFatalFailure()) return;
  }
  EXPECT_EQ(extended.reports[0].state, FeatureState::kInitializing);
  EXPECT_FALSE(extended.reports[0].located);
  bool relocated = false;
  for (const KeyframeReport& report : extended.reports) relocated |= report.relocated;
  EXPECT_TRUE(relocated);
  EXPECT_EQ(extended.reports.back().state, FeatureState::kGood);
  EXPECT_GT(extended.map->keyframes().size(), keyframes_before);
  EXPECT_LT(extended.Error(), 0.02) << "the keyframes before are placed by scaled direct motion";
}

TEST(FeatureMapper, SaysWhatItWaitsForAndRefusesBadInput) {
  Room blank;
  blank.blank_from_rad = -4.0;
  blank.blank_to_rad = 4.0;
  PacketMaker packets(blank);
  TestRun run;
  run.Process(packets.Make(CirclePose(0.0, 0.9), 1.0), CirclePose(0.0, 0.9));
  EXPECT_EQ(run.reports[0].state, FeatureState::kInitializing);
  EXPECT_NE(run.reports[0].message.find("100 features"), std::string::npos) << run.reports[0].message;
  EXPECT_EQ(run.commits, 0);

  const auto code = [&](const direct::KeyframePacket& packet) { return run.mapper->Process(packet).status().code(); };
  direct::KeyframePacket packet = packets.Make(CirclePose(0.01, 0.9), 1.0);
  direct::KeyframePacket bad = packet;
  bad.keyframe = 0;
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument) << "older than the last";
  bad = packet;
  bad.frame.image = cv::Mat(10, 10, CV_8UC1);
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  bad = packet;
  bad.direct_from_camera.translation().x() = std::nan("");
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  EXPECT_TRUE(run.mapper->Process(packet).ok()) << "nothing of the bad ones was kept";

  const auto commit = [](map::Delta) -> absl::StatusOr<std::shared_ptr<const map::Snapshot>> {
    return absl::ResourceExhaustedError("the disk is full");
  };
  FeatureMapperOptions options;
  options.min_inliers = 1;
  EXPECT_EQ(FeatureMapper::Create(options, run.map, run.session, run.camera, nullptr, commit).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(FeatureMapper::Create({}, run.map, SessionId(9), run.camera, nullptr, commit).status().code(),
            absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(FeatureMapper::Create({}, nullptr, run.session, run.camera, nullptr, commit).status().code(),
            absl::StatusCode::kInvalidArgument);
  auto failing = FeatureMapper::Create(SmallOptions(), run.map, run.session, run.camera, nullptr, commit);
  ASSERT_TRUE(failing.ok());
  const Room room;
  PacketMaker textured(room);
  EXPECT_EQ((*failing)->Process(textured.Make(CirclePose(0.0, 0.9), 1.0)).status().code(),
            absl::StatusCode::kResourceExhausted);
}

}  // namespace
}  // namespace cairn::mapping
