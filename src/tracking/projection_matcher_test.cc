#include "tracking/projection_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "tracking/local_map.h"
#include "tracking/testing_world.h"

namespace cairn::tracking {
namespace {

using namespace testing_world;  // NOLINT

class ProjectionMatcher : public testing::Test {
 protected:
  ProjectionMatcher() {
    Random random(7);
    AddRoom(Vector3d::Zero(), 1500, random, &world_);
    vocabulary_ = TrainVocabulary(world_);
    map_ = BuildMap(world_, PathInRoom(Vector3d::Zero(), 10), *vocabulary_, {}, random);
    truth_ = Look({0.3, 0.0, -1.8}, 0.1);
    view_ = Observe(world_, truth_, map_->info().orb, {}, random);
    grid_ = image::FeatureGrid(view_.features.keypoints, 640, 480);
    map_->points().ForEach([&](const auto& point) { points_.push_back(point.get()); });
  }

  ProjectionMatches Match(const SE3& pose, const ProjectionOptions& options = {},
                          std::span<const std::uint8_t> taken = {}, const DescriptorLists* lists = nullptr) const {
    return MatchByProjection({kPinhole, view_.features, grid_}, pose, points_, map_->info().orb, options, taken, lists);
  }
  bool IsTrue(const PointMatch& match) const {
    const std::int32_t i = view_.point_of_feature[match.feature];
    return i >= 0 &&
           (world_.points[static_cast<std::size_t>(i)].position - points_[match.point]->position).norm() < 1e-9;
  }

  World world_;
  std::shared_ptr<const place::Vocabulary> vocabulary_;
  std::shared_ptr<const map::Snapshot> map_;
  SE3 truth_;
  View view_;
  image::FeatureGrid grid_;
  std::vector<const map::MapPoint*> points_;
};

TEST_F(ProjectionMatcher, FindsAlmostEveryPointOnce) {
  const ProjectionMatches found = Match(truth_);
  int possible = 0, right = 0;
  std::set<std::uint32_t> features;
  for (const PointMatch& match : found.matches) {
    right += IsTrue(match);
    EXPECT_TRUE(features.insert(match.feature).second) << "feature matched twice";
    EXPECT_TRUE(std::binary_search(found.visible.begin(), found.visible.end(), match.point));
  }
  for (const map::MapPoint* point : points_) {
    possible += std::any_of(view_.point_of_feature.begin(), view_.point_of_feature.end(), [&](std::int32_t i) {
      return i >= 0 && world_.points[static_cast<std::size_t>(i)].position == point->position;
    });
  }
  EXPECT_GT(possible, 150);
  // Noise of 0.5 px leaves the radius of 2.5 px or the octave's range now and then.
  EXPECT_GT(right, possible * 0.9);
  EXPECT_LE(static_cast<int>(found.matches.size()) - right, 2);
  EXPECT_TRUE(std::is_sorted(found.matches.begin(), found.matches.end(),
                             [](const PointMatch& a, const PointMatch& b) { return a.point < b.point; }));
}

TEST_F(ProjectionMatcher, ALargerRadiusBridgesAWrongPose) {
  const SE3 off = SE3::Exp((Vector6d() << 0.03, -0.02, 0.02, 0.01, 0.02, 0.0).finished()) * truth_;
  ProjectionOptions wide;
  wide.radius_factor = 8.0;
  EXPECT_GT(Match(off, wide).matches.size(), 4 * Match(off).matches.size());
}

TEST_F(ProjectionMatcher, RespectsThresholdsAndTakenFeatures) {
  ProjectionOptions strict;
  strict.max_distance = 15;
  for (const PointMatch& match : Match(truth_, strict).matches) EXPECT_LE(match.distance, 15);

  std::vector<std::uint8_t> taken(view_.features.size(), 0);
  for (std::size_t i = 0; i < taken.size(); i += 2) taken[i] = 1;
  const auto half = Match(truth_, {}, taken);
  EXPECT_FALSE(half.matches.empty());
  for (const PointMatch& match : half.matches) EXPECT_EQ(match.feature % 2, 1u);

  std::vector<std::uint8_t> all(view_.features.size(), 1);
  EXPECT_TRUE(Match(truth_, {}, all).matches.empty());
}

TEST_F(ProjectionMatcher, DescriptorsOfAllObservationsComeCloser) {
  const DescriptorLists lists = ObservedDescriptors(*map_, points_);
  ASSERT_EQ(lists.size(), points_.size());
  for (std::size_t i = 0; i < points_.size(); ++i) {
    EXPECT_EQ(lists.of(i).size(), std::min<std::size_t>(8, points_[i]->observations.size()));
    EXPECT_EQ(lists.of(i)[0], points_[i]->descriptor);
  }
  const auto typical = Match(truth_), every = Match(truth_, {}, {}, &lists);
  const auto sum = [](const ProjectionMatches& m) {
    double total = 0;
    for (const PointMatch& match : m.matches) total += match.distance;
    return total / static_cast<double>(m.matches.size());
  };
  EXPECT_GE(every.matches.size() + 2, typical.matches.size());
  EXPECT_LT(sum(every), sum(typical));
}

TEST_F(ProjectionMatcher, PredictsTheOctave) {
  int checked = 0;
  for (const PointMatch& match : Match(truth_).matches) {
    const auto projection = PredictPoint(kPinhole, truth_, *points_[match.point], map_->info().orb);
    ASSERT_TRUE(projection.has_value());
    EXPECT_NEAR(projection->octave, view_.features.keypoints[match.feature].octave, 1.0);
    ++checked;
  }
  EXPECT_GT(checked, 100);
  map::MapPoint point;
  point.pixel_size = 0.02f;
  EXPECT_EQ(PredictOctave(point, 10.0, 500.0, {}), 0);
  EXPECT_EQ(PredictOctave(point, 10.0 / 1.2, 500.0, {}), 1);
  EXPECT_EQ(PredictOctave(point, 0.01, 500.0, {}), 7);
  EXPECT_EQ(PredictOctave(point, 100.0, 500.0, {}), 0);
  EXPECT_EQ(PredictOctave(point, 10.0, 1.44 * 500.0, {}), 2) << "a longer lens sees finer";
}

TEST_F(ProjectionMatcher, LeavesOutWhatCannotBeSeen) {
  map::MapPoint point;
  point.position = {0.0, 0.0, 4.0};
  point.pixel_size = static_cast<float>(8.0 / kPinhole.fx_px);
  point.mean_view_direction = {0.0f, 0.0f, 1.0f};
  const image::OrbParameters orb;
  const SE3 front;
  EXPECT_TRUE(PredictPoint(kPinhole, front, point, orb).has_value());
  EXPECT_FALSE(PredictPoint(kPinhole, Look({0, 0, 5}, 0.0), point, orb)) << "behind";
  EXPECT_FALSE(PredictPoint(kPinhole, Look({0, 0, 0}, 1.0), point, orb)) << "outside the image";
  EXPECT_FALSE(PredictPoint(kPinhole, Look({0, 0, -7}, 0.0), point, orb)) << "too far";
  EXPECT_FALSE(PredictPoint(kPinhole, Look({0, 0, 3}, 0.0), point, orb)) << "too near";
  EXPECT_FALSE(PredictPoint(kPinhole, Look({4, 0, 3}, -1.3), point, orb)) << "from aside";
  Pinhole tele = kPinhole;
  tele.fx_px *= 2.0, tele.fy_px *= 2.0;
  EXPECT_TRUE(PredictPoint(tele, Look({0, 0, -7}, 0.0), point, orb)) << "not too far for a long lens";
}

TEST_F(ProjectionMatcher, ChecksItsOptions) {
  EXPECT_TRUE(ProjectionOptions().Validate().ok());
  ProjectionOptions options;
  options.max_ratio = 0.0;
  EXPECT_EQ(options.Validate().code(), absl::StatusCode::kInvalidArgument);
  options = {};
  options.max_distance = 300;
  EXPECT_FALSE(options.Validate().ok());
  options = {};
  options.radius_factor = -1;
  EXPECT_FALSE(options.Validate().ok());
}

TEST_F(ProjectionMatcher, LocalMapsAreOrderedAndComplete) {
  // Points seen by keyframe 5 only make it the reference.
  std::vector<PointId> seen;
  for (const PointId id : map_->keyframe(KeyframeId(5)).points) {
    if (id) seen.push_back(id);
  }
  const LocalMap local = LocalMapOfPoints(*map_, seen);
  EXPECT_EQ(local.reference(), KeyframeId(5));
  EXPECT_GT(local.num_sharing, 3u);
  EXPECT_TRUE(std::is_sorted(local.points.begin(), local.points.end(),
                             [](const auto* a, const auto* b) { return a->id < b->id; }));
  std::set<PointId> expected;
  for (const KeyframeId id : local.keyframes) {
    for (const PointId point : map_->keyframe(id).points) {
      if (point) expected.insert(point);
    }
  }
  EXPECT_EQ(local.points.size(), expected.size());

  const map::Edit edit(map_);
  const LocalMap same = LocalMapOfPoints(edit, seen);
  EXPECT_EQ(same.keyframes, local.keyframes);
  EXPECT_EQ(same.points, local.points);

  LocalMapOptions small;
  small.max_keyframes = 2;
  EXPECT_EQ(LocalMapOfPoints(*map_, seen, small).keyframes.size(), 2u);
  EXPECT_TRUE(LocalMapOfPoints(*map_, std::vector<PointId>{PointId(999999)}).keyframes.empty());

  const std::vector<KeyframeId> around = {KeyframeId(3), KeyframeId(77)};
  const LocalMap of_keyframe = LocalMapOfKeyframes(*map_, around);
  EXPECT_EQ(of_keyframe.reference(), KeyframeId(3));
  EXPECT_EQ(of_keyframe.num_sharing, 1u);
  EXPECT_GT(of_keyframe.keyframes.size(), 1u);
}

}  // namespace
}  // namespace cairn::tracking
