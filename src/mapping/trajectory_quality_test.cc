#include "mapping/trajectory_quality.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "map/testing_map.h"

namespace cairn::mapping {
namespace {

constexpr int kKeyframes = 16;

std::vector<TrajectoryKeyframe> Resolved(const map::Snapshot& map) {
  KeyframeTrajectory trajectory;
  for (int i = 0; i < kKeyframes; ++i) {
    KeyframeTrajectory::Entry entry;
    entry.direct_keyframe = i;
    entry.time_ns = FromSeconds(0.5 * i);
    entry.keyframe = entry.reference = KeyframeId(static_cast<KeyframeId::Value>(i + 1));
    entry.map_per_direct = 1.0;
    entry.direct_from_camera = map.keyframe(entry.keyframe).camera_from_map.Inverse();
    trajectory.Add(entry);
  }
  return trajectory.Resolve(map);
}

std::shared_ptr<const map::Snapshot> Map() {
  static const auto map = map::testing::MakeMap(3, kKeyframes, 1500, 0.5).snapshot;
  return map;
}

TEST(TrajectoryQuality, OfAMapThatHoldsTogether) {
  const auto keyframes = Resolved(*Map());
  const TrajectoryQuality quality = AssessTrajectory(Map(), keyframes, keyframes, {});
  EXPECT_GT(quality.quality, kQualityLimit);
  EXPECT_EQ(quality.warning, "");
  EXPECT_GE(quality.weakest_points, 200);
  ASSERT_EQ(quality.keyframes.size(), static_cast<std::size_t>(kKeyframes));
  for (const KeyframeSigma& sigma : quality.keyframes) {
    EXPECT_GT(sigma.position, 0.0);
    EXPECT_GT(sigma.rotation_rad, 0.0);
    EXPECT_LT(sigma.position, 0.1 * quality.spread);
  }
  EXPECT_NEAR(quality.spread, 0.2 * std::sqrt((kKeyframes * kKeyframes - 1) / 12.0), 0.05) << "0.2 apart on a line";
}

// What few points carry across is told, and not relied on.
TEST(TrajectoryQuality, OfTwoPartsThatHardlyAnythingLinks) {
  map::Edit edit(Map());
  std::vector<map::MapPoint> points;
  Map()->points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) { points.push_back(*point); });
  constexpr KeyframeId::Value kLast = 9;  // of the first part
  int across = 0;
  for (const map::MapPoint& point : points) {
    if (point.observations.size() >= 6 && across < 30) {
      ++across;
      continue;
    }
    const bool first = point.id.value() % 2 == 0;
    for (const map::Observation& seen : point.observations) {
      if (first == (seen.keyframe.value() > kLast) && edit.FindPoint(point.id) != nullptr) {
        edit.RemoveObservation(point.id, seen.keyframe);
      }
    }
  }
  const std::shared_ptr<const map::Snapshot> map = *Map()->Apply(edit.Finish("part"));
  const auto keyframes = Resolved(*map);
  const TrajectoryQuality quality = AssessTrajectory(map, keyframes, keyframes, {});
  EXPECT_LE(quality.weakest_points, 30);
  EXPECT_LT(quality.quality, kQualityLimit);
  EXPECT_EQ(quality.weakest_ns, map->keyframe(KeyframeId(kLast)).time_ns);
  EXPECT_NE(quality.warning.find("points carry the scale"), std::string::npos) << quality.warning;
  EXPECT_GT(std::sqrt(3.0) * quality.position_sigma, 0.1 * quality.spread);
}

TEST(TrajectoryQuality, WhereTheOdometryIsReportedItsDistanceFromTheMapCounts) {
  const auto refined = Resolved(*Map());
  auto reported = refined;
  for (std::size_t i = 4; i < 14; ++i) {
    reported[i].map_from_camera.translation() += Vector3d(0.0, i % 2 == 0 ? 0.3 : -0.3, 0.0);
  }
  const TrajectoryQuality plain = AssessTrajectory(Map(), refined, refined, {});
  const TrajectoryQuality mixed = AssessTrajectory(Map(), refined, reported, std::vector<Stretch>{{4, 14}});
  EXPECT_EQ(mixed.keyframes[2].position, plain.keyframes[2].position);
  const double expected = std::hypot(plain.keyframes[8].position, 0.3 / std::sqrt(3.0));
  EXPECT_NEAR(mixed.keyframes[8].position, expected, 1e-6);
}

}  // namespace
}  // namespace cairn::mapping
