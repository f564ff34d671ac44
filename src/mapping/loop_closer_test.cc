#include "mapping/loop_closer.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>

#include "mapping/full_adjustment.h"
#include "mapping/testing_loop.h"
#include "tracking/graph_distance.h"

namespace cairn::mapping {
namespace {

using testing::Ring;
using testing::RingOptions;
using tracking::KeyframesWithin;

struct Round {
  LoopReport report;  // of the loop, or of the last keyframe
  double error_before = 0.0;
  double error_after = 0.0;
  int keyframes = 0;
};

// Goes round until a loop is closed, or the given number of keyframes has been inserted.
Round GoRound(Ring* ring, int max_keyframes) {
  Round run;
  auto closer = LoopCloser::Create();
  EXPECT_TRUE(closer.ok());
  for (run.keyframes = 1; run.keyframes <= max_keyframes; ++run.keyframes) {
    const KeyframeId keyframe = ring->AddKeyframe();
    if (run.keyframes > 80) run.error_before = ring->Error();
    auto report = closer->Process(keyframe, ring->head());
    EXPECT_TRUE(report.ok()) << report.status();
    if (!report.ok()) return run;
    run.report = *std::move(report);
    if (run.report.closed) break;
  }
  run.error_after = ring->Error();
  return run;
}

TEST(LoopCloser, FindsAndClosesALoopWithScaleDrift) {
  Ring ring;
  const Round run = GoRound(&ring, 110);
  ASSERT_TRUE(run.report.closed) << run.report.evidence.rejected;
  EXPECT_GT(run.keyframes, 85);
  EXPECT_GT(run.error_before, 0.2);
  EXPECT_LE(run.error_after, run.error_before / 5.0);
  EXPECT_TRUE(ring.map()->CheckConsistency().ok()) << ring.map()->CheckConsistency();

  const LoopEvidence& evidence = run.report.evidence;
  EXPECT_GE(evidence.guided_matches, 40);
  EXPECT_GE(evidence.neighbours_agreeing, 4);
  // 90 keyframes of -0.4 % each.
  EXPECT_NEAR(evidence.scale, std::exp(-0.004 * 90.0), 0.03);
  EXPECT_GT(run.report.correction.fused_points, 40);
  // The two sides are linked now.
  const map::Keyframe& current = ring.map()->keyframe(run.report.current);
  int linked = 0;
  for (const map::CovisibilityEdge& edge : current.covisible) linked += edge.keyframe.value() < 30 ? 1 : 0;
  EXPECT_GT(linked, 3);
  // The session remembers it.
  const auto& loops = ring.map()->sessions().at(current.session).loops;
  ASSERT_EQ(loops.size(), 1u);
  EXPECT_EQ(loops[0].keyframe, run.report.current);
  EXPECT_EQ(loops[0].loop_keyframe, run.report.loop);
  EXPECT_EQ(loops[0].matches, evidence.guided_matches);
  EXPECT_GT(loops[0].keyframe_time_ns, loops[0].loop_time_ns);
  // Lengths at the end have grown back, those at the loop keyframe are as they were.
  EXPECT_NEAR(run.report.correction.scales.at(run.report.current), std::exp(0.004 * 90.0), 0.05);
  EXPECT_EQ(run.report.correction.scales.at(run.report.loop), 1.0);
}

// Also when the drift is that of the aligned part, and the new session hangs on both its ends.
TEST(LoopCloser, WhatIsAlignedStaysWhereItIs) {
  Ring ring;
  auto closer = LoopCloser::Create();
  ASSERT_TRUE(closer.ok());
  constexpr int kFirst = 85;
  Round run;
  std::shared_ptr<const map::Snapshot> before;
  while (!run.report.closed && run.keyframes < 110) {
    if (run.keyframes == kFirst) {
      ring.AlignAndBeginSession();
      before = ring.map();
    }
    auto report = closer->Process(ring.AddKeyframe(), ring.head());
    ASSERT_TRUE(report.ok()) << report.status();
    run.report = *std::move(report);
    ++run.keyframes;
  }
  ASSERT_TRUE(run.report.closed) << run.report.evidence.rejected;
  ASSERT_TRUE(before != nullptr) << run.keyframes;
  const SessionId first = ring.map()->keyframe(KeyframeId(1)).session;
  int held = 0, moved = 0;
  ring.map()->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    const map::Keyframe* was = before->keyframes().Find(keyframe->id);
    if (keyframe->session != first) return;
    ASSERT_NE(was, nullptr);
    ++held;
    moved += (was->camera_from_map.Matrix() - keyframe->camera_from_map.Matrix()).norm() > 0.0 ? 1 : 0;
  });
  EXPECT_EQ(held, kFirst);
  EXPECT_GT(std::ranges::count_if(ring.map()->keyframe(run.report.current).covisible,
                                  [](const map::CovisibilityEdge& edge) {
                                    return edge.keyframe > KeyframeId(60) && edge.keyframe <= KeyframeId(kFirst);
                                  }),
            0)
      << "current " << run.report.current.value() << ": the session does not hang on the far end, this shows nothing";
  EXPECT_EQ(moved, 0);
  EXPECT_TRUE(ring.map()->CheckConsistency().ok()) << ring.map()->CheckConsistency();
}

TEST(LoopCloser, IsDeterministic) {
  Ring first, second;
  ASSERT_TRUE(GoRound(&first, 110).report.closed);
  ASSERT_TRUE(GoRound(&second, 110).report.closed);
  ASSERT_EQ(first.map()->revision(), second.map()->revision());
  first.map()->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    const SE3& other = second.map()->keyframe(keyframe->id).camera_from_map;
    EXPECT_EQ(keyframe->camera_from_map.Matrix(), other.Matrix());
  });
  first.map()->points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
    EXPECT_EQ(point->position, second.map()->point(point->id).position);
  });
}

TEST(LoopCloser, PlaceThatLooksTheSameIsNoLoop) {
  RingOptions options;
  options.aliased = true;
  options.scale_drift = -0.001;
  Ring ring(options);
  const Round run = GoRound(&ring, 80);  // not yet all the way round
  EXPECT_FALSE(run.report.closed);
  EXPECT_TRUE(ring.map()->CheckConsistency().ok());
}

TEST(LoopCloser, AliasedRingIsClosedWhereItReallyCloses) {
  RingOptions options;
  options.aliased = true;
  options.scale_drift = -0.002;
  options.seed = 3;
  Ring ring(options);
  const Round run = GoRound(&ring, 110);
  ASSERT_TRUE(run.report.closed) << run.report.evidence.rejected;
  EXPECT_LE(run.error_after, run.error_before / 3.0);
}

TEST(LoopCloser, RejectsWhatDoesNotFit) {
  Ring ring;
  const KeyframeId keyframe = ring.AddKeyframe();
  auto closer = LoopCloser::Create();
  ASSERT_TRUE(closer.ok());
  EXPECT_TRUE(absl::IsNotFound(closer->Process(KeyframeId(99), ring.head()).status()));
  testing::TestHead without_vocabulary(ring.map());
  EXPECT_TRUE(absl::IsFailedPrecondition(closer->Process(keyframe, without_vocabulary).status()));
  LoopOptions options;
  options.min_cells = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(LoopCloser::Create(options).status()));
  options = LoopOptions();
  options.guided_radius_factors.clear();
  EXPECT_TRUE(absl::IsInvalidArgument(LoopCloser::Create(options).status()));
}

TEST(PathLength, FollowsTheSpanningTree) {
  Ring ring;
  std::vector<KeyframeId> ids;
  for (int i = 0; i < 10; ++i) ids.push_back(ring.AddKeyframe());
  const auto whole = PathLength(*ring.map(), ids.back(), ids.front());
  ASSERT_TRUE(whole.has_value());
  const double direct =
      (ring.map()->keyframe(ids.back()).CenterInMap() - ring.map()->keyframe(ids[0]).CenterInMap()).norm();
  EXPECT_GE(*whole, direct);
  EXPECT_LT(*whole, 2.0 * direct);
  EXPECT_EQ(PathLength(*ring.map(), ids[3], ids[3]), 0.0);
  EXPECT_EQ(PathLength(*ring.map(), ids[2], ids[7]), PathLength(*ring.map(), ids[7], ids[2]));
}

TEST(KeyframesWithin, IsFarAroundAnOpenRingAndNearOnceItIsClosed) {
  Ring ring;
  std::vector<KeyframeId> ids;
  for (int i = 0; i < 80; ++i) ids.push_back(ring.AddKeyframe());
  const auto near = KeyframesWithin(*ring.map(), ids.back(), 3.0);
  EXPECT_EQ(near.at(ids.back()), 0.0);
  EXPECT_GT(near.size(), 5u);
  EXPECT_LT(near.size(), 40u);
  for (const auto& [id, length] : near) {
    EXPECT_LE(length, 3.0);
    const double straight =
        (ring.map()->keyframe(id).CenterInMap() - ring.map()->keyframe(ids.back()).CenterInMap()).norm();
    EXPECT_GE(length, straight - 1e-12);
    EXPECT_LE(length, *PathLength(*ring.map(), id, ids.back()) + 1e-12);
  }
  // The first is near by position alone.
  const auto all = KeyframesWithin(*ring.map(), ids.back(), 1e9);
  EXPECT_EQ(all.size(), ring.map()->keyframes().size());
  EXPECT_GT(all.at(ids.front()), 20.0);
  EXPECT_TRUE(KeyframesWithin(*ring.map(), KeyframeId(999), 1e9).empty());

  const Round run = GoRound(&ring, 30);
  ASSERT_TRUE(run.report.closed);
  EXPECT_TRUE(KeyframesWithin(*ring.map(), run.report.current, 6.0).contains(run.report.loop));
}

TEST(FullAdjustment, ImprovesTheClosedLoopAndMergesWithWhatCameSince) {
  Ring ring;
  ASSERT_TRUE(GoRound(&ring, 110).report.closed);
  const double before = ring.Error();
  const auto adjustment = ComputeFullAdjustment(*ring.map(), ComponentId(1));
  ASSERT_TRUE(adjustment.ok()) << adjustment.status();
  EXPECT_FALSE(adjustment->interrupted);
  EXPECT_LT(adjustment->rmse, 1.5);

  // A keyframe that came meanwhile: a copy of the last one, a little aside.
  map::Edit more(ring.map());
  map::Keyframe newest;
  ring.map()->keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) { newest = *keyframe; });
  const std::vector<PointId> points = newest.points;
  const KeyframeId parent = newest.id;
  const SE3 aside = SE3(Quaterniond::Identity(), Vector3d(0.05, 0.0, 0.0));
  newest.camera_from_map = aside * newest.camera_from_map;
  const KeyframeId added = more.AddKeyframe(newest);
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    if (points[i]) more.AddObservation(points[i], added, i);
  }
  ASSERT_TRUE(ring.head().Commit(more.Finish("meanwhile"), {}).ok());
  ASSERT_EQ(ring.map()->keyframe(added).parent, parent);

  map::Edit edit(ring.map());
  MergeFullAdjustment(*adjustment, edit);
  ASSERT_TRUE(ring.head().Commit(edit.Finish("full bundle adjustment"), {}).ok());
  EXPECT_TRUE(ring.map()->CheckConsistency().ok()) << ring.map()->CheckConsistency();
  const SE3 moved =
      ring.map()->keyframe(added).camera_from_map * ring.map()->keyframe(parent).camera_from_map.Inverse();
  EXPECT_LT((moved.translation() - aside.translation()).norm(), 1e-9);
  EXPECT_LT(ring.Error(), before);
}

TEST(FullAdjustment, StopsWhenAsked) {
  Ring ring;
  for (int i = 0; i < 10; ++i) ring.AddKeyframe();
  std::atomic<bool> stop = true;
  FullAdjustmentOptions options;
  options.stop = &stop;
  const auto stopped = ComputeFullAdjustment(*ring.map(), ComponentId(1), options);
  ASSERT_TRUE(stopped.ok()) << stopped.status();
  EXPECT_TRUE(stopped->interrupted);
  EXPECT_TRUE(stopped->camera_from_map.empty());
  EXPECT_TRUE(absl::IsFailedPrecondition(ComputeFullAdjustment(*map::Snapshot::Empty({}), ComponentId(1)).status()));
  options.first_iterations = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(ComputeFullAdjustment(*ring.map(), ComponentId(1), options).status()));
}

}  // namespace
}  // namespace cairn::mapping
