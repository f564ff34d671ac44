// The public tracker, with a tracker behind it that says what it was given.
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <thread>
#include <vector>

#include "cairn/conversions.h"
#include "cairn/map.h"
#include "client/boundary/impl.h"
#include "client/boundary/testing_map_file.h"
#include "client/conformance/conformance_map.h"

namespace cairn::conformance {
namespace {

using absl::StatusCode;

struct Seen {
  std::vector<api::TrackFrame> frames;
  std::atomic<int> inside = 0;
  bool together = false;  // two calls at once
  bool ended = false;
};

class FakeTracker : public api::Tracker {
 public:
  explicit FakeTracker(Seen* seen) : seen_(seen) {}
  ~FakeTracker() override { seen_->ended = true; }

  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& frame) override {
    if (frame.time_ns == -1) throw std::runtime_error("a library throws");
    if (frame.time_ns == -2) return absl::DataLossError("the map is damaged");
    if (++seen_->inside > 1) seen_->together = true;
    seen_->frames.push_back(frame);
    api::TrackAnswer answer;
    answer.time_ns = frame.time_ns;
    answer.state = static_cast<api::TrackState>(frame.time_ns % 4);
    answer.reason = "because";
    answer.map_from_camera = SE3(ExpSO3({0.1, 0.2, 0.3}), {1.0, 2.0, 3.0});
    answer.component = ComponentId(5);
    answer.world_from_camera = SE3(ExpSO3({0.3, 0.2, 0.1}), {4.0, 5.0, 6.0});
    answer.world_per_map = 2.5;
    answer.world_is_metric = true;
    for (int i = 0; i < 36; ++i) answer.covariance(i / 6, i % 6) = i;
    answer.map_id = "id";
    answer.revision = 77;
    answer.matched_ns = 3;
    answer.inliers = 44;
    answer.note = "the map was removed";
    answer.track_ms = 0.5;
    --seen_->inside;
    return answer;
  }

 private:
  Seen* seen_;
};

class PublicTracker : public testing::Test {
 protected:
  static Camera SmallCamera() { return Camera::FromPinhole({8, 6, 5.0, 5.0, 3.5, 2.5}); }

  Seen seen_;
  v0::Tracker tracker_{std::make_unique<v0::Tracker::Impl>(SmallCamera(), std::make_unique<FakeTracker>(&seen_))};
  cv::Mat image_ = cv::Mat(6, 8, CV_8UC1, cv::Scalar(40));
};

TEST_F(PublicTracker, NothingIsLost) {
  const auto answer = tracker_.Track(*v0::ViewOf(image_), 9);
  ASSERT_TRUE(answer.ok()) << answer.status();
  EXPECT_EQ(answer->time_ns, 9);
  EXPECT_EQ(answer->state, v0::TrackState::kTracked);
  EXPECT_EQ(answer->reason, "because");
  EXPECT_EQ(answer->map_from_camera.translation, (std::array<double, 3>{1.0, 2.0, 3.0}));
  const Quaterniond q = ExpSO3({0.1, 0.2, 0.3}).normalized();
  EXPECT_EQ(answer->map_from_camera.rotation_xyzw, (std::array<double, 4>{q.x(), q.y(), q.z(), q.w()}));
  EXPECT_EQ(answer->component, 5u);
  EXPECT_EQ(answer->world_from_camera.translation[2], 6.0);
  EXPECT_EQ(answer->world_per_map, 2.5);
  EXPECT_TRUE(answer->world_is_metric);
  EXPECT_EQ(answer->covariance[8], 8.0);
  EXPECT_EQ(answer->map_id, "id");
  EXPECT_EQ(answer->revision, 77u);
  EXPECT_EQ(answer->matched_ns, 3);
  EXPECT_EQ(answer->inliers, 44);
  EXPECT_EQ(answer->note, "the map was removed");
  EXPECT_EQ(answer->track_ms, 0.5);
  const char* names[] = {"located", "tracked", "carried", "lost"};
  for (int i = 0; i < 4; ++i) {
    EXPECT_STREQ(v0::TrackStateName(tracker_.Track(*v0::ViewOf(image_), 100 + i)->state), names[i]);
  }
}

TEST_F(PublicTracker, ThePixelsBelongToTheCallerAfterwards) {
  ASSERT_TRUE(tracker_.Track(*v0::ViewOf(image_), 1).ok());
  image_.setTo(0);
  EXPECT_EQ(seen_.frames[0].image.at<std::uint8_t>(5, 7), 40);
  const cv::Mat color(6, 8, CV_8UC3, cv::Scalar(255, 0, 0));
  ASSERT_TRUE(tracker_.Track(*v0::ViewOf(color), 2).ok());
  EXPECT_EQ(seen_.frames[1].image.type(), CV_8UC1);
  EXPECT_EQ(seen_.frames[1].image.at<std::uint8_t>(0, 0), 29) << "blue, as ITU-R BT.601 weighs it";
}

TEST_F(PublicTracker, BadImagesAndCallsDoNotReachIt) {
  EXPECT_EQ(tracker_.Track({}, 1).status().code(), StatusCode::kInvalidArgument);
  const cv::Mat other(6, 9, CV_8UC1, cv::Scalar(0));
  EXPECT_EQ(tracker_.Track(*v0::ViewOf(other), 1).status().code(), StatusCode::kInvalidArgument);
  const auto late = v0::CallOptions::Within(std::chrono::nanoseconds(-1));
  EXPECT_EQ(tracker_.Track(*v0::ViewOf(image_), 1, late).status().code(), StatusCode::kDeadlineExceeded);
  v0::Cancellation cancellation;
  cancellation.Cancel();
  v0::CallOptions cancelled;
  cancelled.cancellation = &cancellation;
  EXPECT_EQ(tracker_.Track(*v0::ViewOf(image_), 1, cancelled).status().code(), StatusCode::kCancelled);
  EXPECT_TRUE(seen_.frames.empty());
}

TEST_F(PublicTracker, WhatIsThrownOrFailsIsAStatus) {
  const auto thrown = tracker_.Track(*v0::ViewOf(image_), -1).status();
  EXPECT_EQ(thrown.code(), StatusCode::kInternal);
  EXPECT_THAT(std::string(thrown.message()), testing::HasSubstr("a library throws"));
  EXPECT_EQ(tracker_.Track(*v0::ViewOf(image_), -2).status().code(), StatusCode::kDataLoss);
  EXPECT_TRUE(tracker_.Track(*v0::ViewOf(image_), 5).ok());
}

TEST_F(PublicTracker, ThreadsTakeTurns) {
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&, i] {
      for (int k = 0; k < 200; ++k) EXPECT_TRUE(tracker_.Track(*v0::ViewOf(image_), 1000 * i + k).ok());
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_FALSE(seen_.together);
  EXPECT_EQ(seen_.frames.size(), 800u);
}

TEST_F(PublicTracker, IsMovedAndEnds) {
  v0::Tracker other = std::move(tracker_);
  EXPECT_EQ(tracker_.Track(*v0::ViewOf(image_), 1).status().code(), StatusCode::kFailedPrecondition);
  EXPECT_TRUE(other.Track(*v0::ViewOf(image_), 1).ok());
  EXPECT_FALSE(seen_.ended);
  { const v0::Tracker last = std::move(other); }
  EXPECT_TRUE(seen_.ended);
}

TEST(NewTracker, FollowsOrSaysWhatIsWrong) {
  const TestingMapFile file("new_tracker");
  ASSERT_TRUE(WriteConformanceMap(file.path).ok());
  const auto map = v0::Map::Open(file.path);
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_EQ(map->NewTracker({}).status().code(), StatusCode::kInvalidArgument);
  const v0::Camera camera = map->Info()->cameras.at(0).camera;
  v0::TrackerOptions options;
  options.mode = static_cast<v0::TrackMode>(9);
  EXPECT_EQ(map->NewTracker(camera, options).status().code(), StatusCode::kInvalidArgument);
  const auto late = v0::CallOptions::Within(std::chrono::nanoseconds(-1));
  EXPECT_EQ(map->NewTracker(camera, {}, late).status().code(), StatusCode::kDeadlineExceeded);
  for (const auto mode : {v0::TrackMode::kSemiDirect, v0::TrackMode::kFeatures}) {
    options.mode = mode;
    options.deterministic = true;
    auto tracker = map->NewTracker(camera, options);
    ASSERT_TRUE(tracker.ok()) << tracker.status();
    const ConformanceMap& conformance = TheConformanceMap();
    for (int i = 0; i < 10; ++i) {
      const SE3 camera_from_map = LookInRoom({0.02 * i, 0.0, -1.4}, 0.05);
      const cv::Mat image = conformance.room.Render(conformance.pinhole, camera_from_map);
      const auto answer = tracker->Track(*v0::ViewOf(image), 1 + i * 33'000'000);
      ASSERT_TRUE(answer.ok()) << answer.status();
      ASSERT_NE(answer->state, v0::TrackState::kLost) << answer->reason;
      EXPECT_NEAR(answer->map_from_camera.translation[0], 0.02 * i, 0.01);
    }
  }
}

}  // namespace
}  // namespace cairn::conformance
