#include "direct/retained_frames.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace cairn::direct {
namespace {

using ::testing::ElementsAre;

Frame FrameAt(std::int64_t index, TimeNs time_ns) {
  Frame frame;
  frame.index = index;
  frame.time_ns = time_ns;
  return frame;
}

std::vector<std::int64_t> Indices(const std::deque<RetainedFrame>& frames) {
  std::vector<std::int64_t> indices;
  for (const RetainedFrame& retained : frames) indices.push_back(retained.frame.index);
  return indices;
}

TEST(RetainedFrames, ThinnedWhereTheyAreClosestInTimeAndStillInOrder) {
  RetainedFrames frames(3);
  const TimeNs times_ns[] = {0, 10, 20, 22, 24, 40, 50};
  for (int i = 0; i < 6; ++i) frames.Add(FrameAt(i, times_ns[i]), 100 + i);
  frames.MarkReference();
  frames.Add(FrameAt(6, times_ns[6]), 106);
  frames.Thin();
  // 3 lies between 20 and 24 ns; then 2 between 10 and 24. The oldest, the reference and what follows it stay.
  EXPECT_THAT(Indices(frames.start()), ElementsAre(0, 1, 4, 5, 6));
  EXPECT_EQ(frames.reference(), 3u);
  EXPECT_EQ(frames.SinceReference(0).frame.index, 5);
  EXPECT_EQ(frames.SinceReference(1).position, 106u);
}

TEST(RetainedFrames, AreAllKeptSinceTheReferenceAndUpToTheBoundBefore) {
  RetainedFrames frames(4);
  for (int i = 0; i < 20; ++i) frames.Add(FrameAt(i, i), i);
  frames.Thin();
  EXPECT_EQ(frames.start().size(), 20u) << "the first is the reference until another one is marked";
  frames.MarkReference();
  frames.Thin();
  EXPECT_EQ(frames.start().size(), 5u);
  EXPECT_EQ(frames.reference(), 4u);
  frames.ClearStart();
  EXPECT_TRUE(frames.start().empty());
  EXPECT_EQ(frames.reference(), 0u);
}

// A camera that stands for long and then moves, waiting all the time: what the motion looked like is kept.
TEST(RetainedFrames, TheFramesOfAMotionStayThoseOfAStandGo) {
  constexpr int kBound = 30, kIdle = 200, kMoving = 20;
  RetainedFrames frames(kBound);
  for (int i = 0; i < kIdle + kMoving; ++i) {
    Frame frame = FrameAt(i, i * 33);
    frame.image = cv::Mat(60, 80, CV_8UC1);
    const int shift = std::max(0, i - kIdle + 1);
    for (int y = 0; y < 60; ++y) {
      for (int x = 0; x < 80; ++x) {
        const double noise = (x * 7 + y * 13 + i * 5) % 3;
        frame.image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(120 + 80 * std::sin(0.2 * (x + shift)) + noise);
      }
    }
    frames.Add(frame, static_cast<std::size_t>(i));
    frames.MarkReference();
    frames.Thin();
    ASSERT_LE(frames.start().size(), kBound + 1u);
  }
  const std::vector<std::int64_t> kept = Indices(frames.start());
  EXPECT_EQ(kept.front(), 0);
  for (int i = kIdle - 1; i < kIdle + kMoving; ++i) EXPECT_TRUE(std::ranges::count(kept, i) == 1) << i;
}

// A wait of any length: never more than the bound, from the whole time.
TEST(RetainedFrames, ALongWaitKeepsEvenlySpreadFrames) {
  constexpr int kBound = 10, kFrames = 1000;
  RetainedFrames frames(kBound);
  for (int i = 0; i < kFrames; ++i) {
    frames.Add(FrameAt(i, i * 33), i);
    frames.MarkReference();
    frames.Thin();
    ASSERT_LE(frames.start().size(), kBound + 1u);
  }
  const std::vector<std::int64_t> kept = Indices(frames.start());
  EXPECT_EQ(kept.front(), 0);
  EXPECT_EQ(kept.back(), kFrames - 1);
  for (std::size_t i = 1; i < kept.size(); ++i) {
    EXPECT_GT(kept[i], kept[i - 1]);
    EXPECT_LE(kept[i] - kept[i - 1], 3 * kFrames / kBound) << "up to " << kept[i];
  }
}

TEST(RetainedFrames, TheLostWaitFirst) {
  RetainedFrames frames(10);
  frames.Add(FrameAt(1, 1), 1);
  EXPECT_THAT(Indices(frames.Waiting()), ElementsAre(1));
  frames.AddLost(FrameAt(2, 2), 2);
  frames.AddLost(FrameAt(3, 3), 3);
  EXPECT_THAT(Indices(frames.Waiting()), ElementsAre(2, 3));
  frames.ClearStart();
  EXPECT_THAT(Indices(frames.lost()), ElementsAre(2, 3));
  frames.ClearLost();
  EXPECT_TRUE(frames.Waiting().empty());
}

}  // namespace
}  // namespace cairn::direct
