// The stages of local mapping, each on a small map with known truth.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "map/testing_map.h"
#include "mapping/culling.h"
#include "mapping/local_adjustment.h"
#include "mapping/local_mapper.h"
#include "mapping/new_points.h"
#include "mapping/point_fusion.h"
#include "mapping/view_record.h"

namespace cairn::mapping {
namespace {

using map::testing::MakeMap;
using map::testing::TestMap;

TEST(NewPoints, TriangulatesWhatNoPointKnowsYet) {
  const TestMap world = MakeMap(1, 5, 600);
  map::Edit edit(world.snapshot);
  // Half of the points go; triangulation must find them again, where they were.
  std::vector<Vector3d> gone;
  world.snapshot->points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
    if (point->id.value() % 2 == 0 || point->observations.size() < 5) return;
    gone.push_back(point->position);
    edit.ErasePoint(point->id);
  });
  const std::vector<KeyframeId> neighbours = {KeyframeId(1), KeyframeId(2)};
  const auto added = TriangulateWith(edit, KeyframeId(5), neighbours, {}, 1.0, DepthRangeOf(edit, KeyframeId(5)),
                                     TriangulationOptions{});
  EXPECT_GT(added.size(), 0.9 * static_cast<double>(gone.size()));
  int right = 0;
  for (const PointId id : added) {
    EXPECT_EQ(edit.point(id).observations.size(), 2u);
    for (const Vector3d& truth : gone) right += (edit.point(id).position - truth).norm() < 0.01 ? 1 : 0;
  }
  EXPECT_GT(right, 0.98 * static_cast<double>(added.size()));
}

TEST(NewPoints, AreNotMadeWhereThePointsAreEnough) {
  const TestMap world = MakeMap(1, 5, 1200);
  map::Edit edit(world.snapshot);
  // Every second point goes, and on the left half of the last image all but every tenth.
  const map::Keyframe& last = world.snapshot->keyframe(KeyframeId(5));
  for (std::size_t i = 0; i < last.points.size(); ++i) {
    if (!last.points[i]) continue;
    const bool left = last.keypoints()[i].x_px < 320.0f;
    if (left ? i % 10 != 0 : i % 2 == 0) edit.ErasePoint(last.points[i]);
  }
  constexpr int kEnough = 4;
  const auto covered = CoveredFeatures(edit, KeyframeId(5), kEnough, 1);
  int left = 0, right = 0;
  for (std::size_t i = 0; i < covered.size(); ++i) {
    (last.keypoints()[i].x_px < 320.0f ? left : right) += covered[i];
  }
  EXPECT_GT(right, 100);
  EXPECT_LT(left, right / 4);

  TriangulationOptions options;
  options.covered_points = kEnough;
  options.covered_age = 1;
  const std::vector<KeyframeId> neighbours = {KeyframeId(1), KeyframeId(2)};
  const auto added =
      TriangulateWith(edit, KeyframeId(5), neighbours, {}, 1.0, DepthRangeOf(edit, KeyframeId(5)), options);
  EXPECT_GT(added.size(), 50u);
  for (const PointId id : added) {
    for (const map::Observation& observation : edit.point(id).observations) {
      EXPECT_TRUE(observation.keyframe != KeyframeId(5) || !covered[observation.feature]);
    }
  }
  options.covered_points = 0;
  const auto all =
      TriangulateWith(edit, KeyframeId(5), neighbours, {}, 1.0, DepthRangeOf(edit, KeyframeId(5)), options);
  EXPECT_GT(all.size(), 50u) << "the others were left out for being covered";
  // Points that have just come cover nothing: where the camera is for the first time, the map grows freely.
  const auto young = CoveredFeatures(edit, KeyframeId(5), kEnough, 5);
  EXPECT_EQ(std::count(young.begin(), young.end(), 1), 0);
}

TEST(NewPoints, GatesOnParallaxAndBaseline) {
  const TestMap world = MakeMap(2, 3, 300);
  for (const bool parallax : {true, false}) {
    map::Edit edit(world.snapshot);
    const DepthRange range = DepthRangeOf(edit, KeyframeId(3));
    for (const PointId point : world.snapshot->keyframe(KeyframeId(3)).points) {
      if (point && edit.FindPoint(point) != nullptr && point.value() % 2 == 0) edit.ErasePoint(point);
    }
    TriangulationOptions options;
    (parallax ? options.min_parallax_deg : options.min_baseline_share) = parallax ? 30.0 : 0.5;
    EXPECT_TRUE(TriangulateWith(edit, KeyframeId(3), std::vector{KeyframeId(2)}, {}, 1.0, range, options).empty());
  }
}

TEST(NewPoints, FromDepthsAtTheGivenScale) {
  const TestMap world = map::testing::MakeWorld(3, 1, 200);
  Random random(1);
  std::vector<std::size_t> visible;
  map::Edit edit(world.snapshot);
  const KeyframeId id = edit.AddKeyframe(map::testing::MakeKeyframe(world, 0, 0.0, random, &visible));
  std::vector<KeypointDepth> depths(visible.size());
  for (std::size_t i = 0; i < visible.size(); i += 2) {
    depths[i] = {2.0 / (world.poses[0] * world.truth[visible[i]]).z(), 1e-6};
  }
  const auto added = PointsFromDepths(edit, id, depths, 2.0);
  EXPECT_EQ(added.size(), (visible.size() + 1) / 2);
  for (const PointId point : added) {
    const std::uint32_t feature = edit.point(point).observations[0].feature;
    EXPECT_LT((edit.point(point).position - world.truth[visible[feature]]).norm(), 1e-4);
  }
}

TEST(PointFusion, JoinsDoublesAndAddsObservations) {
  const TestMap world = MakeMap(4, 4, 300);
  map::Edit edit(world.snapshot);
  // Keyframe 4 gets points of its own for half of what it sees, and nothing for the rest.
  const std::vector<PointId> points = world.snapshot->keyframe(KeyframeId(4)).points;
  int doubles = 0, missing = 0;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    if (!points[i] || world.snapshot->point(points[i]).observations.size() < 3) continue;
    edit.RemoveObservation(points[i], KeyframeId(4));
    if (i % 2 == 0) {
      edit.AddObservation(edit.AddPoint(world.snapshot->point(points[i]).position), KeyframeId(4), i);
      edit.UpdatePoint(edit.keyframe(KeyframeId(4)).points[i]);
      ++doubles;
    } else {
      ++missing;
    }
    edit.UpdatePoint(points[i]);
  }
  GridCache grids;
  const auto around = std::vector{KeyframeId(1), KeyframeId(2), KeyframeId(3)};
  const FusionCounts counts = FuseAround(edit, KeyframeId(4), around, grids, FusionOptions{});
  EXPECT_GT(counts.fused, 0.95 * doubles);
  EXPECT_GT(counts.observations, 0.95 * missing);
  int restored = 0, expected = 0;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    if (!points[i] || world.snapshot->point(points[i]).observations.size() < 3) continue;
    ++expected;
    restored += edit.keyframe(KeyframeId(4)).points[i] == points[i] ? 1 : 0;
  }
  EXPECT_GT(restored, 0.95 * expected) << "the point with more observations stays";
  const auto next = world.snapshot->Apply(edit.Finish("fuse"));
  ASSERT_TRUE(next.ok()) << next.status();
  EXPECT_TRUE((*next)->CheckConsistency().ok());
}

TEST(LocalAdjustment, RepairsADisturbedKeyframeAndDropsWrongObservations) {
  const TestMap world = MakeMap(5, 6, 400, 0.3);
  map::Edit edit(world.snapshot);
  const SE3 truth = world.poses[5];
  Vector6d disturbance;
  disturbance << 0.03, -0.02, 0.02, 0.01, -0.01, 0.005;
  edit.SetPose(KeyframeId(6), SE3::Exp(disturbance) * truth);
  // A wrong link: the point is moved to another feature of the same keyframe.
  const std::vector<PointId> points = world.snapshot->keyframe(KeyframeId(6)).points;
  std::uint32_t a = 0;
  while (!points[a] || world.snapshot->point(points[a]).observations.size() < 4) ++a;
  std::uint32_t b = 0;
  while (b < points.size() && points[b]) ++b;
  ASSERT_LT(b, points.size()) << "a feature without a point";
  edit.RemoveObservation(points[a], KeyframeId(6));
  ASSERT_TRUE(edit.AddObservation(points[a], KeyframeId(6), b));
  const auto report = AdjustKeyframes(edit, KeyframesToAdjust(edit, KeyframeId(6), 2, SessionId(1)));
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_TRUE(report->adjusted);
  EXPECT_EQ(report->keyframes, 2);
  EXPECT_GE(report->fixed_keyframes, 3);
  EXPECT_LT((edit.keyframe(KeyframeId(6)).camera_from_map * truth.Inverse()).Log().norm(), 0.005);
  EXPECT_FALSE(edit.keyframe(KeyframeId(6)).points[b]) << "the wrong observation is gone";
  EXPECT_TRUE(edit.FindPoint(points[a]) != nullptr);
}

TEST(LocalAdjustment, KeepsTheScaleOfAMapThatHangsOnOneKeyframe) {
  const TestMap world = MakeMap(5, 6, 400, 0.3);
  map::Edit edit(world.snapshot);
  Random random(7);
  std::vector<std::pair<PointId, Vector3d>> points_before;
  world.snapshot->points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
    points_before.emplace_back(point->id, point->position);
  });
  std::vector<KeyframeId> all;
  for (KeyframeId::Value id = 1; id <= 6; ++id) {
    all.emplace_back(id);
    Vector6d disturbance;
    for (int i = 0; i < 6; ++i) disturbance[i] = (i < 3 ? 0.05 : 0.005) * random.Normal();
    if (id > 1) edit.SetPose(all.back(), SE3::Exp(disturbance) * world.poses[id - 1]);
  }
  // A scale that is not the points' own, as if the cameras had been placed in another unit.
  for (const auto& [id, point] : points_before) edit.SetPosition(id, 1.02 * point);
  LocalAdjustmentOptions options;
  options.first_iterations = options.second_iterations = options.noise_iterations = 30;
  const auto report = AdjustKeyframes(edit, all, options);
  ASSERT_TRUE(report.ok()) << report.status();
  EXPECT_LT(report->rmse, 0.5);
  const Vector3d origin = edit.keyframe(all[0]).CenterInMap();
  std::vector<double> ratios;
  for (const auto& [id, point] : points_before) {
    if (edit.FindPoint(id) != nullptr)
      ratios.push_back((edit.point(id).position - origin).norm() / (1.02 * point - origin).norm());
  }
  std::sort(ratios.begin(), ratios.end());
  EXPECT_NEAR(ratios[ratios.size() / 2], 1.0, 1e-4);
}

TEST(Culling, PointsThatAreNotFoundOrNotSeenEnough) {
  const TestMap world = MakeMap(6, 3, 200);
  map::Edit edit(world.snapshot);
  std::vector<PointId> watched;
  for (const PointId point : world.snapshot->keyframe(KeyframeId(1)).points) {
    if (point) watched.push_back(point);
  }
  ASSERT_GT(watched.size(), 10u);
  edit.AddVisibility(watched[0], 9, 0);
  int thin = 0;
  for (const PointId point : watched) thin += edit.point(point).observations.size() < 3 ? 1 : 0;
  const bool first_thin = edit.point(watched[0]).observations.size() < 3;
  PointCuller culler;
  culler.Watch(watched, 1);
  const FeatureMapperOptions options;
  EXPECT_EQ(culler.Cull(edit, 1, options), 1) << "the one that is never found";
  EXPECT_EQ(edit.FindPoint(watched[0]), nullptr);
  EXPECT_EQ(culler.Cull(edit, 3, options), thin - (first_thin ? 1 : 0)) << "those with two observations";
  EXPECT_EQ(culler.Cull(edit, 4, options), 0);
}

TEST(Culling, ClutterIsWhatIsRarelyFoundWhereItWasOftenToBeSeen) {
  const FeatureMapperOptions options;
  map::MapPoint point;
  point.times_visible = options.judged_after;
  point.times_found = 2;
  EXPECT_TRUE(IsClutter(point, options));
  point.times_found = options.judged_after / 2;
  EXPECT_FALSE(IsClutter(point, options)) << "found every other time";
  point.times_visible = options.judged_after - 1;
  point.times_found = 0;
  EXPECT_FALSE(IsClutter(point, options)) << "not to be seen often enough to judge";

  // A local mapper drops them when it inserts the next keyframe.
  const TestMap world = MakeMap(6, 3, 200);
  map::Edit edit(world.snapshot);
  std::vector<PointId> points;
  for (const PointId id : world.snapshot->keyframe(KeyframeId(1)).points) {
    if (id) points.push_back(id);
  }
  LocalMapper mapper(options, SessionId(1), [](const map::Edit&, const map::Keyframe&, const map::Keyframe&) {});
  const std::vector<PointId> found(points.begin() + 1, points.end());
  for (int i = 0; i < 2 * options.judged_after; ++i) mapper.CountVisible(points, found);
  InsertionRequest request;
  request.keyframe = world.snapshot->keyframe(KeyframeId(3));
  const auto inserted = mapper.Insert(edit, std::move(request));
  ASSERT_TRUE(inserted.ok()) << inserted.status();
  EXPECT_EQ(edit.FindPoint(points[0]), nullptr);
  EXPECT_NE(edit.FindPoint(points[1]), nullptr);
}

TEST(Culling, KeyframesThatShowNothingNew) {
  TestMap world = map::testing::MakeWorld(7, 1, 300);
  // Six keyframes at one place: all but three are redundant.
  for (int i = 0; i < 5; ++i) world.poses.push_back(world.poses[0]);
  map::Edit edit(world.snapshot);
  Random random(1);
  std::vector<PointId> points;
  for (std::size_t view = 0; view < 6; ++view) {
    std::vector<std::size_t> visible;
    const KeyframeId id = edit.AddKeyframe(map::testing::MakeKeyframe(world, view, 0.0, random, &visible));
    for (std::uint32_t i = 0; i < visible.size(); ++i) {
      if (view == 0) points.push_back(edit.AddPoint(world.truth[visible[i]]));
      edit.AddObservation(points[i], id, i);
    }
  }
  const auto snapshot = world.snapshot->Apply(edit.Finish("views"));
  ASSERT_TRUE(snapshot.ok());
  map::Edit culling(*snapshot);
  EXPECT_EQ(RedundantShare(culling, KeyframeId(3), 3), 1.0);
  const FeatureMapperOptions options;
  const int culled = CullKeyframes(culling, KeyframeId(6), options.redundancy,
                                   [&](KeyframeId id) { return culling.EraseKeyframe(id); });
  EXPECT_EQ(culled, 3) << "then three views are left: two others are not enough";
  EXPECT_NE(culling.FindKeyframe(KeyframeId(1)), nullptr) << "the root stays";

  std::vector<KeyframeId> all;
  culling.base().keyframes().ForEach([&](const auto& keyframe) { all.push_back(keyframe->id); });
  EXPECT_EQ(
      CullAmong(culling, all, options.redundancy_of_visits, [&](KeyframeId id) { return culling.EraseKeyframe(id); }),
      1)
      << "for a visit two others are enough";
}

TEST(ViewRecord, RefinesAPoseAgainstTheMap) {
  const TestMap world = MakeMap(8, 3, 300);
  const map::Keyframe& keyframe = world.snapshot->keyframe(KeyframeId(2));
  const ViewRecord view = MakeViewRecord(keyframe.keypoints(), keyframe.points, world.snapshot->info().orb);
  EXPECT_FALSE(view.empty());
  Vector6d off;
  off << 0.02, 0.01, 0, 0.01, 0, 0;
  const auto refined =
      RefineView(*world.snapshot, map::testing::kPinhole, view, SE3::Exp(off) * keyframe.camera_from_map, 25);
  ASSERT_TRUE(refined);
  EXPECT_LT((*refined * keyframe.camera_from_map.Inverse()).Log().norm(), 1e-4);
  EXPECT_FALSE(RefineView(*world.snapshot, map::testing::kPinhole, ViewRecord{}, SE3(), 25));
}

}  // namespace
}  // namespace cairn::mapping
