// A lost odometry that is told where it is goes on at once.
#include <gtest/gtest.h>

#include <cmath>

#include "direct/odometry.h"
#include "direct/testing_scene.h"

namespace cairn::direct {
namespace {

constexpr int kLostFrom = 26;  // from here on the camera is elsewhere

SE3 PoseAt(double t) {
  const SE3 elsewhere(Quaterniond::Identity(), Vector3d(9.0, -0.2, 0.5));
  return t < kLostFrom ? testing::SwayPose(t) : elsewhere * testing::SwayPose(t - kLostFrom);
}

const Frame& FrameAt(int i) {
  static const std::vector<Frame> frames = [] {
    const testing::Scene scene;
    std::vector<Frame> all;
    for (int k = 0; k < 56; ++k) all.push_back(scene.Render(testing::TestCamera(), PoseAt(k), k));
    return all;
  }();
  return frames[static_cast<std::size_t>(i)];
}

// As a map knows it: a few hundred points, in units of its own.
KnownView ViewOf(int i, double unit_m = 2.5) {
  const testing::Scene scene;
  KnownView view;
  view.frame_index = i;
  for (int y = 8; y < 280; y += 12) {
    for (int x = 8; x < 376; x += 12) {
      const double depth_m = scene.Depth(testing::TestCamera(), PoseAt(i), Vector2d(x, y));
      view.points.push_back({static_cast<float>(x), static_cast<float>(y), static_cast<float>(unit_m / depth_m), 0.0f});
    }
  }
  return view;
}

std::unique_ptr<Odometry> LostOdometry(int last_frame) {
  auto odometry = Odometry::Create({}, testing::TestCamera());
  EXPECT_TRUE(odometry.ok()) << odometry.status();
  for (int i = 0; i <= last_frame; ++i) EXPECT_TRUE((*odometry)->Process(FrameAt(i)).ok());
  return *std::move(odometry);
}

// Metres per direct unit of the second segment, from the largest baseline in it; `error`: the largest distance from the
// truth after that scale, in metres.
double ScaleOf(const std::vector<FrameResult>& results, int origin, double* error_m) {
  double scale = 0.0, longest = 0.0;
  const auto moved = [&](const FrameResult& r) {
    return PoseAt(origin).Inverse() * PoseAt(static_cast<double>(r.index));
  };
  for (const FrameResult& r : results) {
    const double truth = moved(r).translation().norm();
    if (r.segment != 1 || truth < longest) continue;
    longest = truth;
    scale = truth / r.direct_from_camera.translation().norm();
  }
  *error_m = 0.0;
  for (const FrameResult& r : results) {
    if (r.segment != 1) continue;
    *error_m = std::max(*error_m, (moved(r).translation() - scale * r.direct_from_camera.translation()).norm());
  }
  return scale;
}

TEST(OdometryRecovery, GoesOnFromAKnownViewWithoutWaitingForMotion) {
  const auto odometry = LostOdometry(30);
  ASSERT_EQ(odometry->FrameResults().back().state, TrackingState::kLost);
  const KnownView view = ViewOf(29);
  ASSERT_TRUE(odometry->GoOnFrom(view).ok());
  for (int i = 31; i < 56; ++i) {
    const auto result = odometry->Process(FrameAt(i));
    ASSERT_TRUE(result.ok());
    EXPECT_GE(result->keyframe, 0) << i;
    EXPECT_EQ(result->segment, 1) << i;
  }
  odometry->Finish();
  EXPECT_EQ(odometry->Statistics().segments, 2);
  EXPECT_EQ(odometry->Statistics().recoveries, 1);
  const std::vector<FrameResult> results = odometry->FrameResults();
  for (const FrameResult& result : results)
    EXPECT_GE(result.keyframe, 0) << result.index;  // those before and after, too
  double error_m;
  const double scale = ScaleOf(results, 29, &error_m);
  std::vector<float> depths;
  for (const PacketPoint& point : view.points) depths.push_back(2.5f / point.inverse_depth);
  std::nth_element(depths.begin(), depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2), depths.end());
  EXPECT_NEAR(scale / depths[depths.size() / 2], 1.0, 0.03) << "the unit is the median depth of the known points";
  EXPECT_LT(error_m, 0.02);
}

// The answer comes late, while frames wait to be mapped, and its first keyframe is handed out at once.
TEST(OdometryRecovery, TheAnswerMayComeLate) {
  const auto odometry = LostOdometry(28);
  odometry->TakePackets();
  for (int i = 29; i < 34; ++i) ASSERT_TRUE(odometry->Track(FrameAt(i)).ok());
  ASSERT_TRUE(odometry->GoOnFrom(ViewOf(30)).ok());
  for (int i = 34; i < 37; ++i) ASSERT_TRUE(odometry->Track(FrameAt(i)).ok());
  while (odometry->OptimizeNext()) {
  }
  const std::vector<FrameResult> results = odometry->FrameResults();
  for (const FrameResult& result : results) EXPECT_GE(result.keyframe, 0) << result.index;
  const std::vector<KeyframePacket> packets = odometry->TakePackets();
  ASSERT_FALSE(packets.empty());
  const auto first = std::find_if(packets.begin(), packets.end(), [](const auto& p) { return p.segment == 1; });
  ASSERT_NE(first, packets.end());
  EXPECT_EQ(first->frame.index, 30);
  EXPECT_TRUE(first->still_active);
  EXPECT_GT(first->points.size(), 300u);
  EXPECT_EQ(odometry->PendingFrames(), 0);
}

// Also once it has given up and waits for parallax.
TEST(OdometryRecovery, EndsTheWaitForANewStart) {
  OdometryOptions options;
  options.max_lost_frames = 3;
  const auto odometry = *Odometry::Create(options, testing::TestCamera());
  for (int i = 0; i < kLostFrom; ++i) ASSERT_TRUE(odometry->Process(FrameAt(i)).ok());
  Frame still = FrameAt(kLostFrom);
  for (; still.index < kLostFrom + 8; ++still.index) {
    still.time_ns = still.index * 33'333'333;
    ASSERT_TRUE(odometry->Process(still).ok());
  }
  ASSERT_EQ(odometry->FrameResults().back().state, TrackingState::kInitializing);
  KnownView view = ViewOf(kLostFrom);
  view.frame_index = kLostFrom + 6;
  ASSERT_TRUE(odometry->GoOnFrom(view).ok());
  still.time_ns = still.index * 33'333'333;
  const auto result = odometry->Process(still);
  ASSERT_TRUE(result.ok());
  EXPECT_GE(result->keyframe, 0);
  for (const FrameResult& frame : odometry->FrameResults()) EXPECT_GE(frame.keyframe, 0) << frame.index;
}

TEST(OdometryRecovery, ChangesNothingWhereItIsNotLostOrTheFrameIsUnknown) {
  const auto odometry = LostOdometry(25);
  ASSERT_TRUE(odometry->GoOnFrom(ViewOf(24)).ok());
  while (odometry->OptimizeNext()) {
  }
  EXPECT_EQ(odometry->Statistics().segments, 1);
  EXPECT_GE(odometry->FrameResults().back().keyframe, 0);
  ASSERT_TRUE(odometry->Process(FrameAt(26)).ok());
  ASSERT_TRUE(odometry->Process(FrameAt(27)).ok());
  KnownView unknown = ViewOf(27);
  unknown.frame_index = 99;
  ASSERT_TRUE(odometry->GoOnFrom(unknown).ok());
  while (odometry->OptimizeNext()) {
  }
  EXPECT_EQ(odometry->Statistics().segments, 1);

  KnownView bad = ViewOf(27);
  bad.points[3].inverse_depth = -1.0f;
  EXPECT_EQ(odometry->GoOnFrom(bad).code(), absl::StatusCode::kInvalidArgument);
  bad.points.resize(3);
  EXPECT_EQ(odometry->GoOnFrom(bad).code(), absl::StatusCode::kInvalidArgument);
  odometry->Finish();
  EXPECT_EQ(odometry->GoOnFrom(ViewOf(27)).code(), absl::StatusCode::kFailedPrecondition);
}

TEST(OdometryRecovery, AFreshOdometryBeginsWhereItIsTold) {
  const auto odometry = *Odometry::Create({}, testing::TestCamera());
  const KnownView view = ViewOf(29);
  const auto begun = odometry->BeginFrom(FrameAt(29), view);
  ASSERT_TRUE(begun.ok()) << begun.status();
  EXPECT_EQ(begun->keyframe, 0);
  EXPECT_EQ(begun->segment, 0);
  const std::vector<KeyframePacket> packets = odometry->TakePackets();
  ASSERT_EQ(packets.size(), 1u);
  EXPECT_EQ(packets[0].frame.index, 29);
  for (int i = 30; i < 56; ++i) {
    const auto result = odometry->Process(FrameAt(i));
    ASSERT_TRUE(result.ok());
    ASSERT_GE(result->keyframe, 0) << i;
    const auto motion = odometry->Motion(*begun, *result);
    ASSERT_TRUE(motion);
    const SE3 truth = PoseAt(29).Inverse() * PoseAt(i);
    EXPECT_LT(AngleRad((*motion * truth.Inverse()).rotation()), 0.01) << i;
  }
  EXPECT_FALSE(odometry->Motion(*begun, FrameResult()));
}

// Anew, elsewhere, while it still tracks.
TEST(OdometryRecovery, BeginsAnewWhereItIsTold) {
  const auto odometry = LostOdometry(24);
  const auto begun = odometry->BeginFrom(FrameAt(29), ViewOf(29));
  ASSERT_TRUE(begun.ok()) << begun.status();
  EXPECT_EQ(begun->segment, 1);
  const auto next = odometry->Process(FrameAt(30));
  ASSERT_TRUE(next.ok());
  EXPECT_EQ(next->segment, 1);
  EXPECT_EQ(odometry->BeginFrom(FrameAt(30), ViewOf(30)).status().code(), absl::StatusCode::kInvalidArgument)
      << "a frame that it has had";
  KnownView few = ViewOf(31);
  few.points.resize(3);
  EXPECT_EQ(odometry->BeginFrom(FrameAt(31), few).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_GE(odometry->Process(FrameAt(31))->keyframe, 0) << "nothing has changed";
}

}  // namespace
}  // namespace cairn::direct
