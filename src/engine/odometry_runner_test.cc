#include "engine/odometry_runner.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <new>

#include "engine/testing_sway.h"

namespace cairn::engine {
namespace {

using ::testing::HasSubstr;

std::unique_ptr<OdometryRunner> MakeRunner(bool in_background, OdometryRunner::AfterMapping after_mapping) {
  OdometryRunnerOptions options;
  options.in_background = in_background;
  auto runner = OdometryRunner::Create(options, direct::testing::TestCamera(), std::move(after_mapping));
  EXPECT_TRUE(runner.ok()) << runner.status();
  return *std::move(runner);
}

direct::Frame FrameAt(int i) {
  const RawFrame raw = testing::Sway(i + 1).back();
  direct::Frame frame;
  frame.index = raw.index;
  frame.time_ns = raw.time_ns;
  frame.image = raw.gray;
  return frame;
}

absl::Status Nothing(direct::Odometry& odometry) {
  odometry.TakePackets();
  return absl::OkStatus();
}

TEST(OdometryRunner, RefusesTimesThatDoNotFollowAndGoesOn) {
  for (const bool in_background : {false, true}) {
    const auto runner = MakeRunner(in_background, Nothing);
    for (int i = 0; i < 10; ++i) {
      direct::Frame frame = FrameAt(i);
      ASSERT_TRUE(runner->AddFrame(frame).ok());
      ++frame.index;  // so that only the time is wrong
      frame.time_ns -= i % 2;
      const absl::Status repeated = runner->AddFrame(frame).status();
      EXPECT_EQ(repeated.code(), absl::StatusCode::kInvalidArgument);
      EXPECT_THAT(std::string(repeated.message()), HasSubstr("is not after that of the frame before"));
    }
    ASSERT_TRUE(runner->Finish().ok());
    EXPECT_EQ(runner->odometry().FrameResults().size(), 10u) << "the odometry has seen none of the others";
    EXPECT_EQ(runner->frame_ms().count(), 10);
    EXPECT_EQ(runner->recent_frames().size(), 10u);
  }
}

TEST(OdometryRunner, WhatALibraryThrowsInTheThreadIsAnErrorOfTheNextFrames) {
  for (const bool in_background : {false, true}) {
    const auto runner = MakeRunner(in_background, [](direct::Odometry&) -> absl::Status { throw std::bad_alloc(); });
    absl::Status status;
    for (int i = 0; i < 40 && status.ok(); ++i) status = runner->AddFrame(FrameAt(i)).status();
    EXPECT_EQ(status.code(), absl::StatusCode::kResourceExhausted) << status;
    EXPECT_EQ(runner->Finish().code(), absl::StatusCode::kResourceExhausted);
  }
}

}  // namespace
}  // namespace cairn::engine
