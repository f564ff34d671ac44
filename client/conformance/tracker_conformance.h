// The test suite of api::Tracker: every implementation passes the same one. Include it in one file of a test binary
// that links cairn::localizer_conformance, and instantiate it with a factory and what its way of tracking can:
//
//   INSTANTIATE_TEST_SUITE_P(Local, TrackerConformance, testing::Values(TrackerCase{"SemiDirect", &OpenLocal, true}));
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <functional>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <ostream>
#include <string>
#include <vector>

#include "api/tracker.h"
#include "client/conformance/conformance_map.h"
#include "geometry/camera.h"
#include "map/edit.h"
#include "store/map_store.h"

namespace cairn::conformance {

struct TrackerCase {
  std::string name;
  // Makes a tracker of the map file at `map_path`. It may keep what it needs (a server, say) alive in the tracker.
  std::function<absl::StatusOr<std::unique_ptr<api::Tracker>>(const std::string& map_path, const Camera& camera)> open;
  bool carries = true;  // goes on where the map does not reach
};
inline void PrintTo(const TrackerCase& tracker, std::ostream* out) { *out << tracker.name; }

class TrackerConformance : public testing::TestWithParam<TrackerCase> {
 protected:
  static constexpr TimeNs kFrameNs = 33'333'333;

  void SetUp() override {
    path_ = testing::TempDir() + "/tracker_conformance_" + std::to_string(getpid()) + ".cairn";
    std::remove(path_.c_str());
    ASSERT_TRUE(WriteConformanceMap(path_).ok());
    Open(Camera::FromPinhole(TheConformanceMap().pinhole));
  }
  void TearDown() override {
    tracker_.reset();
    std::remove(path_.c_str());
  }
  void Open(const Camera& camera) {
    tracker_.reset();
    auto tracker = GetParam().open(path_, camera);
    ASSERT_TRUE(tracker.ok()) << tracker.status();
    tracker_ = *std::move(tracker);
    camera_ = camera;
    next_ns_ = 1'000'000'000;
  }

  // A walk along the mapped wall, to and fro, in small steps.
  static SE3 WalkAt(int frame) {
    const double t = 0.02 * frame;
    return LookInRoom({-0.7 + 0.6 * (1.0 - std::cos(t)), 0.04 * std::sin(2.0 * t), -1.4}, 0.2 * std::sin(1.3 * t));
  }
  cv::Mat ImageAt(const SE3& camera_from_map) const {
    return TheConformanceMap().room.Render(camera_, camera_from_map);
  }
  api::TrackAnswer Track(const cv::Mat& image) {
    const auto answer = tracker_->Track({image, next_ns_});
    EXPECT_TRUE(answer.ok()) << answer.status();
    api::TrackAnswer given = answer.ok() ? *answer : api::TrackAnswer();
    EXPECT_EQ(given.time_ns, next_ns_);
    next_ns_ += kFrameNs;
    return given;
  }
  api::TrackAnswer TrackAt(const SE3& camera_from_map) { return Track(ImageAt(camera_from_map)); }

  static double ErrorOf(const api::TrackAnswer& answer, const SE3& camera_from_map) {
    return (answer.map_from_camera.translation() - camera_from_map.Inverse().translation()).norm();
  }
  static void ExpectPose(const api::TrackAnswer& answer, const SE3& camera_from_map, double within = 0.03) {
    ASSERT_NE(answer.state, api::TrackState::kLost) << answer.reason;
    EXPECT_LT(ErrorOf(answer, camera_from_map), within) << api::TrackStateName(answer.state);
    EXPECT_LT(AngleRad((answer.map_from_camera * camera_from_map).rotation()), 0.02);
  }
  static double PositionVariance(const api::TrackAnswer& answer) {
    Eigen::Matrix<double, 3, 6> by_increment;
    by_increment << Matrix3d::Identity(), -Hat(answer.map_from_camera.translation());
    return (by_increment * answer.covariance * by_increment.transpose()).trace();
  }
  std::string Digest() const {
    const auto store = store::OpenMapStore(path_, store::OpenMode::kRead);
    EXPECT_TRUE(store.ok()) << store.status();
    return *(*store)->ContentDigest();
  }

  std::string path_;
  std::unique_ptr<api::Tracker> tracker_;
  Camera camera_;
  TimeNs next_ns_ = 0;
};

TEST_P(TrackerConformance, FollowsAWalkAndSaysAgainstWhat) {
  const map::Snapshot& map = *TheConformanceMap().snapshot;
  const std::string before = Digest();
  for (int i = 0; i < 90; ++i) {
    const SE3 truth = WalkAt(i);
    const api::TrackAnswer answer = TrackAt(truth);
    ExpectPose(answer, truth);
    EXPECT_EQ(answer.state == api::TrackState::kLocated, i == 0) << i;
    EXPECT_TRUE(answer.state == api::TrackState::kLocated || answer.state == api::TrackState::kTracked)
        << answer.reason;
    EXPECT_EQ(answer.map_id, map.info().id);
    EXPECT_EQ(answer.revision, map.revision());
    EXPECT_EQ(answer.component, ComponentId(1));
    EXPECT_GT(answer.matched_ns, 0);
    EXPECT_LE(answer.matched_ns, answer.time_ns);
    EXPECT_GE(answer.inliers, 25);
    EXPECT_TRUE(answer.note.empty()) << answer.note;
    // The map is aligned.
    EXPECT_TRUE(answer.world_is_metric);
    EXPECT_EQ(answer.world_per_map, 2.0);
    const Vector3d expected = 2.0 * answer.map_from_camera.translation() + Vector3d(10.0, 0.0, 0.0);
    EXPECT_LT((answer.world_from_camera.translation() - expected).norm(), 1e-9);
    // Sure, but not too sure.
    EXPECT_GT(answer.covariance.diagonal().minCoeff(), 0.0);
    EXPECT_LT(PositionVariance(answer), 0.05 * 0.05);
    EXPECT_LT(ErrorOf(answer, truth), 5.0 * std::sqrt(PositionVariance(answer)));
  }
  EXPECT_EQ(Digest(), before) << "the map is not touched";
}

// To the wall behind, of which the map knows nothing, and back.
TEST_P(TrackerConformance, CarriedWhereTheMapDoesNotReach) {
  if (!GetParam().carries) GTEST_SKIP() << "tracks by the map alone";
  const auto turned = [](double yaw_rad) { return LookInRoom({0.1 * yaw_rad, 0.0, -1.2}, yaw_rad); };
  for (int i = 0; i < 10; ++i)
    ExpectPose(TrackAt(LookInRoom({0.01 * (i - 9), 0.0, -1.2}, 0.0)), LookInRoom({0.01 * (i - 9), 0.0, -1.2}, 0.0));
  int carried = 0;
  double variance = 0.0;
  constexpr int kSteps = 90;
  for (int i = 1; i <= kSteps; ++i) {
    const double yaw_rad = 2.0 * i / kSteps;
    const api::TrackAnswer answer = TrackAt(turned(yaw_rad));
    ExpectPose(answer, turned(yaw_rad), 0.1);
    if (answer.state != api::TrackState::kCarried) continue;
    EXPECT_FALSE(answer.reason.empty());
    EXPECT_GE(PositionVariance(answer), variance * 0.999) << "grows";
    variance = PositionVariance(answer);
    ++carried;
  }
  EXPECT_GT(carried, 10);
  api::TrackAnswer answer;
  for (int i = kSteps; i >= -30; --i) {
    const SE3 truth = i > 0 ? turned(2.0 * i / kSteps) : LookInRoom({0.005 * i, 0.0, -1.2}, 0.0);
    answer = TrackAt(truth);
    ExpectPose(answer, truth, 0.1);
  }
  EXPECT_EQ(answer.state, api::TrackState::kTracked) << answer.reason;
  // The map is matched beside the calls, and later on a busy machine: by then less of what was carried is corrected.
  EXPECT_LT(ErrorOf(answer, LookInRoom({-0.15, 0.0, -1.2}, 0.0)), 0.05);
  EXPECT_LT(PositionVariance(answer), variance);
}

TEST_P(TrackerConformance, LostInTheDarkAndFoundAgain) {
  for (int i = 0; i < 5; ++i) ExpectPose(TrackAt(WalkAt(i)), WalkAt(i));
  const cv::Mat black(camera_.height_px, camera_.width_px, CV_8UC1, cv::Scalar(0));
  api::TrackAnswer answer;
  for (int i = 0; i < 20; ++i) answer = Track(black);
  EXPECT_EQ(answer.state, api::TrackState::kLost);
  EXPECT_FALSE(answer.reason.empty());
  EXPECT_EQ(answer.map_id, TheConformanceMap().snapshot->info().id);
  // Somewhere else, after a while.
  next_ns_ += 5'000'000'000;
  int until = 0;
  do {
    answer = TrackAt(WalkAt(100 + until));
  } while (answer.state == api::TrackState::kLost && ++until < 20);
  EXPECT_LT(until, 20) << "found without being told";
  ExpectPose(answer, WalkAt(100 + until));
  for (int i = until + 1; i < until + 10; ++i) ExpectPose(TrackAt(WalkAt(100 + i)), WalkAt(100 + i));
}

TEST_P(TrackerConformance, AnotherRoomIsNotTakenForThisOne) {
  const RenderedRoom other(77);
  for (int i = 0; i < 12; ++i) {
    const api::TrackAnswer answer = Track(other.Render(camera_, WalkAt(i)));
    EXPECT_EQ(answer.state, api::TrackState::kLost);
    EXPECT_FALSE(answer.reason.empty());
  }
}

// A camera with another size, focal length and lens than the map's.
TEST_P(TrackerConformance, FollowsAnotherCamera) {
  const Camera camera = AnotherCamera();
  Open(camera);
  for (int i = 0; i < 40; ++i) ExpectPose(TrackAt(WalkAt(i)), WalkAt(i));
}

// As soon as enough images agree on it.
TEST_P(TrackerConformance, AFocalLengthThatIsOffIsTold) {
  for (int i = 0; i < 20; ++i) EXPECT_EQ(TrackAt(WalkAt(i)).focal_factor, 1.0);
  const Camera right = camera_;
  Camera wrong = right;
  wrong.fx_px *= 1.15;
  wrong.fy_px *= 1.15;
  Open(wrong);
  api::TrackAnswer answer;
  for (int i = 0; i < 60; ++i) answer = Track(TheConformanceMap().room.Render(right, WalkAt(i)));
  EXPECT_NEAR(answer.focal_factor, 1.0 / 1.15, 0.06);
}

TEST_P(TrackerConformance, BadInputIsAnErrorAndChangesNothing) {
  const cv::Mat good = ImageAt(WalkAt(0));
  EXPECT_NE(Track(good).state, api::TrackState::kLost);
  cv::Mat colour;
  cv::cvtColor(good, colour, cv::COLOR_GRAY2BGR);
  for (const cv::Mat& bad : {cv::Mat(), colour, good(cv::Rect(0, 0, 100, 100)).clone()}) {
    EXPECT_EQ(tracker_->Track({bad, next_ns_}).status().code(), absl::StatusCode::kInvalidArgument);
  }
  EXPECT_EQ(tracker_->Track({good, next_ns_ - kFrameNs}).status().code(), absl::StatusCode::kInvalidArgument)
      << "a time that does not grow";
  ExpectPose(TrackAt(WalkAt(1)), WalkAt(1));
}

// The caller may use its memory for the next image at once.
TEST_P(TrackerConformance, TheImageIsTheCallersAgain) {
  cv::Mat buffer;
  for (int i = 0; i < 30; ++i) {
    ImageAt(WalkAt(i)).copyTo(buffer);
    const api::TrackAnswer answer = Track(buffer);
    ExpectPose(answer, WalkAt(i));
    buffer.setTo(255);
  }
}

TEST_P(TrackerConformance, FollowsAWriter) {
  ExpectPose(TrackAt(WalkAt(0)), WalkAt(0));
  auto writer = store::OpenMapStore(path_, store::OpenMode::kWrite);
  ASSERT_TRUE(writer.ok()) << writer.status();
  const auto map = *(*writer)->LoadSnapshot();
  map::Edit edit(map);
  map::Component component = map->component(ComponentId(1));
  component.world_from_component = Sim3(Quaterniond::Identity(), Vector3d(0.0, 7.0, 0.0), 3.0);
  edit.PutComponent(component);
  ASSERT_TRUE((*writer)->Commit(edit.Finish("aligned anew")).ok());
  api::TrackAnswer answer;
  int i = 1;
  for (; i < 400 && answer.revision != map->revision() + 1; ++i) {
    answer = TrackAt(WalkAt(i));
    ExpectPose(answer, WalkAt(i));
  }
  EXPECT_EQ(answer.revision, map->revision() + 1);
  EXPECT_EQ(answer.world_per_map, 3.0);
}

}  // namespace cairn::conformance
