#include "engine/odometry_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "engine/odometry_runner.h"
#include "engine/testing_sway.h"

namespace cairn::engine {
namespace {

using ::testing::HasSubstr;

absl::StatusOr<OdometryReport> RunAll(const OdometrySessionOptions& options, const std::vector<RawFrame>& frames) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<OdometrySession> session,
                         OdometrySession::Create(options, testing::SwaySource()));
  for (const RawFrame& frame : frames) CAIRN_RETURN_IF_ERROR(session->AddFrame(frame).status());
  return session->Finish();
}

TEST(OdometrySession, OneThreadGivesWhatDeterministicGives) {
  OdometrySessionOptions deterministic, one;
  deterministic.deterministic = true;
  one.threads = 1;
  const auto a = RunAll(deterministic, testing::Sway(30)), b = RunAll(one, testing::Sway(30));
  ASSERT_TRUE(a.ok() && b.ok()) << a.status() << b.status();
  EXPECT_EQ(a->segments, 1);
  ASSERT_EQ(a->frame_poses.size(), 30u);
  ASSERT_EQ(b->frame_poses.size(), 30u);
  for (std::size_t i = 0; i < 30; ++i) {
    EXPECT_EQ(a->frame_poses[i].segment, 0);
    EXPECT_EQ(a->frame_poses[i].direct_from_camera.Matrix(), b->frame_poses[i].direct_from_camera.Matrix());
  }
}

TEST(OdometrySession, ThreadsTrackEveryFrame) {
  const auto report = RunAll({}, testing::Sway(40));
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->frames_tracked, 40);
  EXPECT_EQ(report->longest_segment_frames, 40);
  EXPECT_EQ(report->frame_ms.count(), 40);
  // Distances from the first frame against the truth, whose scale is another.
  const auto way = [](const SE3& first, const SE3& at) { return (at.translation() - first.translation()).norm(); };
  const auto estimated = [&](std::size_t i) {
    return way(report->frame_poses[0].direct_from_camera, report->frame_poses[i].direct_from_camera);
  };
  const auto truth = [&](int i) { return way(direct::testing::SwayPose(0), direct::testing::SwayPose(i)); };
  for (const int i : {10, 20, 30}) {
    EXPECT_NEAR(estimated(static_cast<std::size_t>(i)) / estimated(39), truth(i) / truth(39), 0.02) << "frame " << i;
  }
}

TEST(OdometrySession, SaysWhyItNeverStarted) {
  for (const int threads : {1, 2}) {
    OdometrySessionOptions options;
    options.threads = threads;
    const auto report = RunAll(options, testing::Still(6));
    EXPECT_EQ(report.status().code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(report.status().message()), HasSubstr("the camera has not moved enough"));
    EXPECT_THAT(std::string(RunAll(options, {}).status().message()), HasSubstr("no frame to track"));
  }
}

TEST(OdometrySession, AFrameThatDoesNotFitIsRefusedAndTheSessionGoesOn) {
  auto session = OdometrySession::Create({}, testing::SwaySource());
  ASSERT_TRUE(session.ok()) << session.status();
  std::vector<RawFrame> frames = testing::Sway(25);
  frames[20].gray = cv::Mat(10, 10, CV_8UC1, cv::Scalar(0));
  for (const RawFrame& frame : frames) {
    const auto result = (*session)->AddFrame(frame);
    EXPECT_EQ(result.ok(), frame.index != 20) << result.status();
  }
  const auto report = (*session)->Finish();
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_EQ(report->frames, 24);
  EXPECT_EQ(report->frames_tracked, 24);
}

TEST(OdometrySession, BadOptionsAndCamerasAreRefused) {
  OdometrySessionOptions options;
  options.threads = 0;
  EXPECT_FALSE(OdometrySession::Create(options, testing::SwaySource()).ok());
  options = {};
  options.odometry.max_keyframes = 100;
  EXPECT_FALSE(OdometrySession::Create(options, testing::SwaySource()).ok());
  SessionSource source = testing::SwaySource();
  source.camera.fx_px = 0.0;
  EXPECT_FALSE(OdometrySession::Create({}, source).ok());
}

direct::Frame ToFrame(const RawFrame& raw) {
  direct::Frame frame;
  frame.index = raw.index;
  frame.time_ns = raw.time_ns;
  frame.image = raw.gray;
  return frame;
}

TEST(OdometryRunner, MappingNeverLagsFurtherThanAllowed) {
  OdometryRunnerOptions options;
  options.max_pending = 2;
  int most = 0, mapped = 0;
  auto runner = OdometryRunner::Create(options, direct::testing::TestCamera(), [&](direct::Odometry& odometry) {
    most = std::max(most, odometry.PendingFrames());
    ++mapped;
    return absl::OkStatus();
  });
  ASSERT_TRUE(runner.ok()) << runner.status();
  for (const RawFrame& raw : testing::Sway(25)) ASSERT_TRUE((*runner)->AddFrame(ToFrame(raw)).ok());
  ASSERT_TRUE((*runner)->Finish().ok());
  EXPECT_LE(most, 2 + 1);  // one that was handed over before the start is tracked late, and queued again
  EXPECT_GE(mapped, 15);
  EXPECT_EQ((*runner)->odometry().PendingFrames(), 0);
}

TEST(OdometryRunner, AnErrorAfterMappingEndsTheRunWithThatError) {
  for (const bool in_background : {false, true}) {
    OdometryRunnerOptions options;
    options.in_background = in_background;
    auto runner = OdometryRunner::Create(options, direct::testing::TestCamera(),
                                         [&](direct::Odometry&) { return absl::DataLossError("the disk broke"); });
    ASSERT_TRUE(runner.ok()) << runner.status();
    absl::Status status;
    for (const RawFrame& raw : testing::Sway(20)) {
      status = (*runner)->AddFrame(ToFrame(raw)).status();
      if (!status.ok()) break;
    }
    EXPECT_EQ(status.code(), absl::StatusCode::kDataLoss);
    EXPECT_EQ((*runner)->AddFrame(ToFrame(testing::Sway(40).back())).status().code(), absl::StatusCode::kDataLoss);
    EXPECT_EQ((*runner)->Finish().code(), absl::StatusCode::kDataLoss);
  }
}

TEST(OdometryRunner, MayBeAbandonedAtAnyTime) {
  for (const int count : {0, 5, 25}) {
    auto runner =
        OdometryRunner::Create({}, direct::testing::TestCamera(), [&](direct::Odometry&) { return absl::OkStatus(); });
    ASSERT_TRUE(runner.ok()) << runner.status();
    for (const RawFrame& raw : testing::Sway(count)) ASSERT_TRUE((*runner)->AddFrame(ToFrame(raw)).ok());
  }
}

}  // namespace
}  // namespace cairn::engine
