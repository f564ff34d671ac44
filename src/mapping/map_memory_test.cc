#include "mapping/map_memory.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "map/testing_map.h"

namespace cairn::mapping {
namespace {

constexpr int kKeyframes = 24;

std::vector<KeyframeTrajectory::Entry> Entries(int segment_begins = kKeyframes) {
  std::vector<KeyframeTrajectory::Entry> entries(kKeyframes);
  for (int i = 0; i < kKeyframes; ++i) {
    auto& entry = entries[static_cast<std::size_t>(i)];
    entry.direct_keyframe = i;
    entry.segment = i < segment_begins ? 0 : 1;
    entry.time_ns = FromSeconds(0.5 * i);
    entry.keyframe = entry.reference = KeyframeId(static_cast<KeyframeId::Value>(i + 1));
  }
  return entries;
}

// Cameras along a line that see most points from end to end.
std::shared_ptr<const map::Snapshot> LongMemory() { return map::testing::MakeMap(3, kKeyframes, 1500).snapshot; }

// The same, but what the first half sees it sees from five keyframes only, and the second half knows none of it.
std::shared_ptr<const map::Snapshot> ShortMemoryFirst() {
  const auto map = LongMemory();
  map::Edit edit(map);
  std::vector<map::MapPoint> points;
  map->points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) { points.push_back(*point); });
  for (const map::MapPoint& point : points) {
    const bool late = point.id.value() % 2 == 0;
    KeyframeId::Value first = std::numeric_limits<KeyframeId::Value>::max();
    for (const map::Observation& seen : point.observations) first = std::min(first, seen.keyframe.value());
    for (const map::Observation& seen : point.observations) {
      const KeyframeId::Value at = seen.keyframe.value();
      const bool stays = late ? at > kKeyframes / 2 : at <= kKeyframes / 2 && at < first + 5;
      if (!stays && edit.FindPoint(point.id) != nullptr) edit.RemoveObservation(point.id, seen.keyframe);
    }
  }
  return *map->Apply(edit.Finish("forget"));
}

TEST(MapMemory, WherePointsOutlastTheWindowAllIsRefined) {
  EXPECT_TRUE(DirectStretches(Entries(), *LongMemory(), {}).empty());
  const TrajectoryChoice choice = ChooseTrajectory(Entries(), {}, false, false);
  EXPECT_TRUE(choice.refined);
}

TEST(MapMemory, WhereNoneDoesAllIsDirect) {
  const auto map = LongMemory();
  const MapMemoryOptions longer = {.window_keyframes = kKeyframes};
  const auto stretches = DirectStretches(Entries(), *map, longer);
  ASSERT_EQ(stretches.size(), 1u);
  EXPECT_EQ(stretches[0].begin, 0u);
  EXPECT_EQ(stretches[0].end, static_cast<std::size_t>(kKeyframes));
  EXPECT_FALSE(ChooseTrajectory(Entries(), stretches, false, false).refined);
  EXPECT_TRUE(DirectStretches(Entries(), *map, {.window_keyframes = kKeyframes, .min_share = 0.0}).empty());
  // What another segment has seen, too, was forgotten and found again.
  EXPECT_TRUE(DirectStretches(Entries(12), *map, longer).empty());
}

TEST(MapMemory, EachStretchIsJudgedByItself) {
  const auto stretches = DirectStretches(Entries(), *ShortMemoryFirst(), {});
  ASSERT_EQ(stretches.size(), 1u);
  EXPECT_EQ(stretches[0].begin, 0u);
  EXPECT_NEAR(static_cast<double>(stretches[0].end), 0.5 * kKeyframes, 3.0);
  const TrajectoryChoice choice = ChooseTrajectory(Entries(), stretches, false, false);
  EXPECT_TRUE(choice.refined) << "of most keyframes";
  EXPECT_NE(choice.reason.find("direct from 0.0 to "), std::string::npos) << choice.reason;
  EXPECT_EQ(ChooseTrajectory(Entries(), stretches, true, false).reason, "refined: a loop was closed");
}

TEST(MapMemory, OptionsAreChecked) {
  EXPECT_TRUE(MapMemoryOptions().Validate().ok());
  EXPECT_FALSE(MapMemoryOptions{.window_keyframes = 0}.Validate().ok());
  EXPECT_FALSE(MapMemoryOptions{.min_share = 1.5}.Validate().ok());
}

}  // namespace
}  // namespace cairn::mapping
