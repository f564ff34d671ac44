#include "tracking/local_map_tracker.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>

#include "tracking/graph_distance.h"
#include "tracking/point_uncertainty.h"
#include "tracking/testing_world.h"

namespace cairn::tracking {
namespace {

using namespace testing_world;  // NOLINT

constexpr double kDepth = 4.0;  // of the walls that the cameras look at

// An image somewhere in a map, and what it observes in truth.
class Query {
 public:
  Query(const World& world, const SE3& truth, const map::Snapshot& map, Random& random)
      : world_(world),
        view_(Observe(world, truth, map.info().orb, {}, random)),
        grid_(view_.features.keypoints, kPinhole.width_px, kPinhole.height_px),
        map_(map) {}

  TrackedView Track(const LocalMapStart& start, const LocalMapTrackerOptions& options = {}) const {
    return TrackLocalMap(map_, {kPinhole, view_.features, grid_}, start, options);
  }
  bool IsTrue(std::size_t feature, PointId point) const {
    const std::int32_t i = view_.point_of_feature[feature];
    return i >= 0 && (world_.points[static_cast<std::size_t>(i)].position - map_.point(point).position).norm() < 1e-9;
  }

 private:
  const World& world_;
  const View view_;
  const image::FeatureGrid grid_;
  const map::Snapshot& map_;
};

class LocalMapTrackerInRoom : public testing::Test {
 protected:
  LocalMapTrackerInRoom() {
    AddRoom(Vector3d::Zero(), 1500, random_, &world_);
    map_ = BuildMap(world_, PathInRoom(Vector3d::Zero(), 10), *TrainVocabulary(world_), {}, random_);
  }

  Random random_{11};
  World world_;
  std::shared_ptr<const map::Snapshot> map_;
  const SE3 truth_ = Look({0.3, 0.0, -1.8}, 0.1);
};

TEST_F(LocalMapTrackerInRoom, FindsThePoseFromARoughOne) {
  const Query query(world_, truth_, *map_, random_);
  for (const Vector3d& off : {Vector3d(0.0, 0.0, 0.0), Vector3d(0.06, 0.0, 0.03), Vector3d(-0.02, 0.05, -0.05)}) {
    const SE3 seed = SE3(ExpSO3(Vector3d(0.005, -0.005, 0.01)), off) * truth_;
    const TrackedView found =
        query.Track({.seed = {seed}, .seen = {}, .anchor = KeyframeId(5), .median_depth = kDepth});
    ASSERT_TRUE(found.tracked);
    EXPECT_LT(CenterError(found.camera_from_map, truth_), 0.01);
    EXPECT_LT(RotationErrorDeg(found.camera_from_map, truth_), 0.15);
    EXPECT_NEAR(found.median_depth, kDepth, 1.0);
    EXPECT_NE(map_->keyframes().Find(found.reference), nullptr);
    int observed = 0, wrong = 0;
    for (std::size_t i = 0; i < found.points.size(); ++i) {
      if (!found.points[i]) continue;
      ++observed;
      wrong += query.IsTrue(i, found.points[i]) ? 0 : 1;
      EXPECT_TRUE(std::binary_search(found.visible.begin(), found.visible.end(), found.points[i]));
    }
    EXPECT_EQ(observed, found.inliers);
    EXPECT_GT(observed, 100);
    EXPECT_LE(wrong, observed / 50);
  }
}

// From image to image: the points seen before first, and those around kept.
TEST_F(LocalMapTrackerInRoom, AlongAPathFindsTheSameAsAlone) {
  LocalPointCache cache;
  std::vector<PointId> seen;
  for (int i = 0; i < 8; ++i) {
    const SE3 truth = Look({0.3 + 0.02 * i, 0.0, -1.8}, 0.1 + 0.01 * i);
    const Query query(world_, truth, *map_, random_);
    const SE3 seed = SE3(ExpSO3(Vector3d(0.002, -0.002, 0.002)), Vector3d(0.01, 0.0, 0.01)) * truth;
    LocalMapStart start{.seed = {seed}, .seen = {}, .anchor = KeyframeId(5), .median_depth = kDepth};
    const TrackedView alone = query.Track(start);
    start.seen = seen;
    start.seen_first = true;
    start.cache = &cache;
    const TrackedView found = query.Track(start);
    ASSERT_TRUE(found.tracked);
    EXPECT_LT(CenterError(found.camera_from_map, alone.camera_from_map), 0.003);
    EXPECT_GE(found.inliers, alone.inliers - 5);
    seen.clear();
    for (const PointId id : found.points) {
      if (id) seen.push_back(id);
    }
    ASSERT_GE(seen.size(), 100u);
  }
}

// What was seen before is somewhere else: the local map is searched as ever.
TEST_F(LocalMapTrackerInRoom, PointsSeenBeforeThatAreNotThereDoNotMatter) {
  const Query query(world_, truth_, *map_, random_);
  std::vector<PointId> seen;
  map_->points().ForEach([&](const auto& point) {
    const Vector3d there = truth_ * point->position;
    const bool in_view = there.z() > 0.0 && kPinhole.Contains(kPinhole.Project(there));
    if (!in_view && seen.size() < 300) seen.push_back(point->id);
  });
  ASSERT_GE(seen.size(), 100u);
  LocalMapStart start{.seed = {truth_}, .seen = seen, .anchor = KeyframeId(5), .median_depth = kDepth};
  start.seen_first = true;
  const TrackedView found = query.Track(start);
  EXPECT_TRUE(found.tracked);
  EXPECT_LT(CenterError(found.camera_from_map, truth_), 0.01);
}

std::vector<KeyframeId> Keyframes(std::uint32_t first, std::uint32_t last) {
  std::vector<KeyframeId> ids;
  for (std::uint32_t id = first; id <= last; ++id) ids.push_back(KeyframeId(id));
  return ids;
}

TEST(LocalPointCache, HoldsWhatIsAskedForAndNotMuchMore) {
  Random random(5);
  World world;
  AddRoom(Vector3d::Zero(), 1000, random, &world);
  const auto map = BuildMap(world, PathInRoom(Vector3d::Zero(), 12), *TrainVocabulary(world), {}, random);
  const auto ids_of = [](std::span<const map::MapPoint* const> points) {
    std::vector<PointId> ids;
    for (const map::MapPoint* point : points) ids.push_back(point->id);
    return ids;
  };
  LocalPointCache cache;
  for (std::uint32_t first = 1; first <= 9; ++first) {
    const std::vector<KeyframeId> wanted = {KeyframeId(first + 2), KeyframeId(first), KeyframeId(first + 3)};
    const std::vector<PointId> given = ids_of(cache.PointsOf(*map, wanted));
    EXPECT_TRUE(std::is_sorted(given.begin(), given.end()));
    LocalPointCache fresh;
    const std::vector<PointId> needed = ids_of(fresh.PointsOf(*map, wanted));
    EXPECT_TRUE(std::includes(given.begin(), given.end(), needed.begin(), needed.end()));
    // Of a room that most keyframes see most of: one more keyframe at most.
    EXPECT_LE(given.size(), ids_of(fresh.PointsOf(*map, Keyframes(first > 1 ? first - 1 : first, first + 3))).size());
  }
}

TEST_F(LocalMapTrackerInRoom, APointSeenFromOneSideIsUnsureFromAside) {
  const map::MapPoint* point = nullptr;
  map_->points().ForEach([&](const auto& p) {
    if (point == nullptr && p->observations.size() >= 4) point = p.get();
  });
  ASSERT_NE(point, nullptr);
  const Vector3d from = point->position - 3.0 * point->mean_view_direction.cast<double>();
  const Vector3d aside = point->mean_view_direction.cast<double>().unitOrthogonal();
  const double front = ProjectedSigma(*map_, *point, from, 500.0, 50.0);
  const double side = ProjectedSigma(*map_, *point, point->position + 3.0 * aside, 500.0, 50.0);
  EXPECT_GT(front, 0.0);
  EXPECT_GT(side, 2.0 * front);
  EXPECT_LE(side, 50.0);
  map::MapPoint once = *point;
  once.observations.resize(1);
  EXPECT_EQ(ProjectedSigma(*map_, once, point->position + 3.0 * aside, 500.0, 50.0), 50.0) << "its depth is not known";
}

TEST_F(LocalMapTrackerInRoom, ASureSeedOutweighsFewMatches) {
  const SE3 seed = SE3(Quaterniond::Identity(), Vector3d(0.01, 0.0, 0.0)) * truth_;
  const Query query(world_, truth_, *map_, random_);
  LocalMapStart start{.seed = {seed}, .seen = {}, .anchor = KeyframeId(5), .median_depth = kDepth};
  const double free = CenterError(query.Track(start).camera_from_map, seed);
  start.seed.translation_sigma = 1e-5;
  start.seed.rotation_sigma_rad = 1e-5;
  const TrackedView held = query.Track(start);
  EXPECT_LT(CenterError(held.camera_from_map, seed), 0.2 * free);
}

TEST_F(LocalMapTrackerInRoom, DoesNotTrackWithoutMatches) {
  const Query query(world_, truth_, *map_, random_);
  const SE3 far = Look({0.3, 0.0, -60.0}, 0.1 + std::numbers::pi);  // away from all there is
  const TrackedView lost = query.Track({.seed = {far}, .seen = {}, .anchor = KeyframeId(5), .median_depth = kDepth});
  EXPECT_FALSE(lost.tracked);
  EXPECT_EQ(lost.matches, 0);
  EXPECT_EQ(CenterError(lost.camera_from_map, far), 0.0) << "the seed is left as it is";
  EXPECT_TRUE(std::all_of(lost.points.begin(), lost.points.end(), [](PointId point) { return !point; }));

  // Nor where nothing is known to look around: no keyframe, and no points.
  EXPECT_FALSE(query.Track({.seed = {truth_}, .seen = {}, .anchor = {}, .median_depth = kDepth}).tracked);
}

// Along a wall and back to where it began; what was seen on the way there is not known again on the way back, so that
// the first keyframes and the last are close, and linked only by the whole way.
class LocalMapTrackerAlongWall : public testing::Test {
 protected:
  static constexpr int kWayOut = 29;  // keyframes

  LocalMapTrackerAlongWall() {
    for (int i = 0; i < 5000; ++i) {
      const Vector3d position(random_.Uniform(-4.0, 25.0), random_.Uniform(-2.0, 2.0), kDepth);
      world_.points.push_back({position, RandomDescriptor(random_), random_.Uniform(4.0, 14.0)});
    }
    std::vector<SE3> poses;
    for (int i = 0; i < kWayOut; ++i) poses.push_back(Look({0.7 * i, 0.0, 0.0}, 0.0));
    for (int i = kWayOut - 2; i >= 0; --i) poses.push_back(Look({0.7 * i + 0.2, 0.0, 0.0}, 0.0));
    map_ = BuildMap(world_, poses, *TrainVocabulary(world_), {}, random_, 4);
    newest_ = KeyframeId(static_cast<KeyframeId::Value>(poses.size()));
  }

  Random random_{12};
  World world_;
  std::shared_ptr<const map::Snapshot> map_;
  KeyframeId newest_;
};

TEST_F(LocalMapTrackerAlongWall, LeavesOutWhatIsReachedOnlyByALongWay) {
  const KeyframeId oldest(1);
  const auto ways = KeyframesWithin(*map_, newest_, 1000.0);
  ASSERT_EQ(ways.size(), map_->keyframes().size());
  EXPECT_GT(ways.at(oldest), 5.0 * kDepth);
  EXPECT_FALSE(KeyframesWithin(*map_, newest_, 5.0 * kDepth).contains(oldest));

  const SE3 truth = Look({0.1, 0.05, 0.0}, 0.02);
  const Query query(world_, truth, *map_, random_);
  const LocalMapStart start{.seed = {truth}, .seen = {}, .anchor = newest_, .median_depth = kDepth};
  const auto near = [](const TrackedView& view, KeyframeId id) { return std::ranges::count(view.nearby, id) == 1; };
  TrackedView found = query.Track(start);
  ASSERT_TRUE(found.tracked);
  EXPECT_LT(CenterError(found.camera_from_map, truth), 0.01);
  EXPECT_TRUE(near(found, newest_));
  EXPECT_FALSE(near(found, oldest));
  EXPECT_GT(found.reference.value(), kWayOut) << "of the way back";

  LocalMapTrackerOptions far_reaching;
  far_reaching.neighbour_way = 1000.0;
  found = query.Track(start, far_reaching);
  ASSERT_TRUE(found.tracked);
  EXPECT_TRUE(near(found, newest_));
  EXPECT_TRUE(near(found, oldest));
}

TEST(LocalMapTrackerOptions, RefusesNonsense) {
  EXPECT_TRUE(LocalMapTrackerOptions().Validate().ok());
  for (const LocalMapTrackerOptions& bad :
       {LocalMapTrackerOptions{.min_inliers = 9}, LocalMapTrackerOptions{.max_keyframes = 0},
        LocalMapTrackerOptions{.search_radius_px = 0.0}, LocalMapTrackerOptions{.refined_search_radius_px = -1.0},
        LocalMapTrackerOptions{.neighbour_distance = -0.1}, LocalMapTrackerOptions{.neighbour_angle_deg = 180.0},
        LocalMapTrackerOptions{.neighbour_way = -1.0}}) {
    EXPECT_EQ(bad.Validate().code(), absl::StatusCode::kInvalidArgument);
  }
}

}  // namespace
}  // namespace cairn::tracking
