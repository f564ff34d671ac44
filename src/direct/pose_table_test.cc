#include "direct/pose_table.h"

#include <gtest/gtest.h>

namespace cairn::direct {
namespace {

SE3 At(double x) { return SE3(Quaterniond::Identity(), Vector3d(x, 0, 0)); }

// Frames at 10 Hz without poses, and keyframes of the given frames, at x = frame.
PoseTable TableOf(int frames, std::initializer_list<int> keyframes, std::int64_t segment = 0) {
  PoseTable table;
  for (int i = 0; i < frames; ++i) {
    FrameResult frame;
    frame.index = i;
    frame.time_ns = i * 100'000'000LL;
    EXPECT_EQ(table.AddFrame(frame), static_cast<std::size_t>(i));
  }
  for (int i : keyframes) {
    const std::int64_t id = table.next_keyframe();
    table.AddKeyframe({id, segment, i, i * 100'000'000LL, At(i), true});
    table.SetPose(static_cast<std::size_t>(i), id, SE3(), 1.0);
  }
  return table;
}

TEST(PoseTable, FramesFollowTheirKeyframe) {
  PoseTable table = TableOf(3, {0}, 4);
  table.SetPose(1, 0, At(0.5), 0.5);
  table.keyframe(0).direct_from_camera = At(10);
  const FrameResult frame = table.Composed(1);
  EXPECT_EQ(frame.direct_from_camera.translation().x(), 10.5);
  EXPECT_EQ(frame.segment, 4);
  EXPECT_EQ(frame.state, TrackingState::kPoor);
  EXPECT_EQ(table.Composed(2).segment, -1);
  EXPECT_EQ(table.CountTracked(), 2);
}

TEST(PoseTable, InterpolatesBetweenNeighboursOnly) {
  PoseTable table = TableOf(10, {2, 6});
  table.Interpolate(0, 7);
  for (int i = 2; i <= 6; ++i) {
    EXPECT_NEAR(table.Composed(static_cast<std::size_t>(i)).direct_from_camera.translation().x(), i, 1e-12);
  }
  EXPECT_LT(table.frames()[4].quality, kPoorQuality);
  EXPECT_FALSE(table.frames()[4].message.empty());
  EXPECT_TRUE(table.frames()[6].message.empty()) << "it has a pose of its own";
  for (std::size_t i : {0, 1, 7, 8}) EXPECT_LT(table.frames()[i].keyframe, 0) << i;
}

TEST(PoseTable, TheNewestPairIsOfOneSegmentAndWithoutALossBetween) {
  PoseTable table = TableOf(6, {1, 2});
  const auto [before, last] = table.LastTracked(0);
  ASSERT_NE(before, nullptr);
  EXPECT_EQ(before->index, 1);
  EXPECT_EQ(last->index, 2);
  EXPECT_EQ(table.LastTracked(1).last, nullptr);
  table.SetPose(5, 1, At(3), 1.0);  // 3 and 4 were lost
  EXPECT_EQ(table.LastTracked(0).last->index, 5);
  EXPECT_EQ(table.LastTracked(0).before, nullptr);
}

TEST(PoseTable, ForgetsASegmentAndItsFrames) {
  PoseTable table = TableOf(4, {0, 1});
  table.AddKeyframe({2, 1, 2, 200'000'000, At(2), true});
  table.SetPose(2, 2, SE3(), 1.0);
  table.Forget(1, 2);
  EXPECT_EQ(table.next_keyframe(), 2);
  EXPECT_EQ(table.frames()[1].keyframe, 1);
  EXPECT_EQ(table.frames()[2].keyframe, -1);
  EXPECT_EQ(table.frames()[2].index, 2);
  EXPECT_EQ(table.frames()[2].state, TrackingState::kInitializing);
}

TEST(PoseTable, KeyframeRateIsOfTheNewestSegment) {
  PoseTable table = TableOf(8, {0, 1, 2});
  EXPECT_NEAR(table.KeyframeRateHz(), 10.0, 1e-9);
  table.AddKeyframe({3, 1, 5, 500'000'000, At(5), true});
  EXPECT_EQ(table.KeyframeRateHz(), 0.0);
  table.AddKeyframe({4, 1, 7, 700'000'000, At(7), true});
  EXPECT_NEAR(table.KeyframeRateHz(), 5.0, 1e-9);
}

TEST(PoseTable, ForgetsWhatNothingHangsOn) {
  PoseTable table;
  std::size_t most = 0;
  constexpr std::size_t kFrames = 5 * PoseTable::kKept;
  for (std::size_t i = 0; i < kFrames; ++i) {
    table.ForgetOld();
    const std::size_t position = table.AddFrame({});
    ASSERT_EQ(position, i);
    // The first one stays in the window for half of the time.
    if (i == kFrames / 2) table.keyframe(0).still_active = false;
    if (i % 2 == 0) {
      const std::int64_t id = table.next_keyframe();
      table.AddKeyframe({id, 0, static_cast<std::int64_t>(i), 0, At(static_cast<double>(i)), i == 0});
    }
    table.SetPose(position, table.next_keyframe() - 1, SE3(), 1.0);
    most = std::max({most, table.frames().size(), table.keyframes().size() * (i > kFrames / 2 + 2 * PoseTable::kKept)});
    EXPECT_EQ(table.DirectFromCamera(table.frame(position)).translation().x(), static_cast<double>(i - i % 2));
    EXPECT_TRUE(i >= kFrames / 2 || table.KnowsKeyframe(0));
  }
  EXPECT_LE(most, 2 * PoseTable::kKept);
  EXPECT_FALSE(table.KnowsKeyframe(0));
  EXPECT_FALSE(table.KnowsKeyframe(table.next_keyframe()));
  EXPECT_EQ(table.end_position(), kFrames);
  EXPECT_EQ(table.CountTracked(), static_cast<std::int64_t>(kFrames));
}

}  // namespace
}  // namespace cairn::direct
