#include "base/frame_times.h"

#include <gtest/gtest.h>

#include <limits>

namespace cairn {
namespace {

constexpr TimeNs kSecond = 1'000'000'000;

TEST(FrameTimes, AcceptsWhatIncreases) {
  FrameTimes times;
  EXPECT_TRUE(times.Accept(-5).ok());
  EXPECT_TRUE(times.Accept(0).ok());
  EXPECT_TRUE(times.Accept(1).ok());
  EXPECT_TRUE(times.Accept(3600 * kSecond).ok()) << "a pause";
}

TEST(FrameTimes, RefusesWhatRepeatsOrGoesBackAndGoesOn) {
  FrameTimes times;
  ASSERT_TRUE(times.Accept(10 * kSecond).ok());
  const absl::Status repeated = times.Accept(10 * kSecond);
  EXPECT_EQ(repeated.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_NE(repeated.message().find("10.000000 s"), absl::string_view::npos) << repeated;
  EXPECT_FALSE(times.Accept(9 * kSecond).ok());
  EXPECT_TRUE(times.Accept(11 * kSecond).ok());
}

TEST(FrameTimes, RefusesTimesThatCannotBe) {
  FrameTimes times;
  EXPECT_FALSE(times.Accept(std::numeric_limits<TimeNs>::max()).ok());
  EXPECT_FALSE(times.Accept(std::numeric_limits<TimeNs>::min()).ok());
  EXPECT_TRUE(times.Accept(0).ok());
}

TEST(FrameTimes, OneBrokenTimeCostsOneFrame) {
  FrameTimes times;
  ASSERT_TRUE(times.Accept(kSecond).ok());
  EXPECT_FALSE(times.Accept(1000 * FrameTimes::kLeapNs).ok());
  EXPECT_TRUE(times.Accept(2 * kSecond).ok());
  EXPECT_FALSE(times.Accept(1000 * FrameTimes::kLeapNs).ok());
  EXPECT_FALSE(times.Accept(1 * kSecond).ok());
  EXPECT_FALSE(times.Accept(1000 * FrameTimes::kLeapNs + 1).ok()) << "not one after the other";
  EXPECT_TRUE(times.Accept(3 * kSecond).ok());
}

TEST(FrameTimes, ARecordingMayBeTakenUpDaysLater) {
  FrameTimes times;
  ASSERT_TRUE(times.Accept(kSecond).ok());
  EXPECT_FALSE(times.Accept(5 * FrameTimes::kLeapNs).ok());
  EXPECT_TRUE(times.Accept(5 * FrameTimes::kLeapNs + kSecond).ok());
  EXPECT_TRUE(times.Accept(5 * FrameTimes::kLeapNs + 2 * kSecond).ok());
}

}  // namespace
}  // namespace cairn
