#include "care/packing.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "care/self_queries.h"
#include "care/testing_room.h"
#include "care/whole_map.h"

namespace cairn::care {
namespace {

using testing::Room;

TEST(Pack, KeepsWhatIsSeenAndIsStillFound) {
  const Room room(5);
  const auto map = room.Map(20, 3);
  const map::MapInfo info = NewMapInfo(map->info(), "packed");
  const auto packed = Pack(*map, info);
  ASSERT_TRUE(packed.ok()) << packed.status();
  const map::Snapshot& small = *packed->map;
  ASSERT_TRUE(small.CheckConsistency().ok()) << small.CheckConsistency();
  EXPECT_EQ(small.info().id, info.id);
  EXPECT_EQ(small.keyframes().size(), map->keyframes().size());
  EXPECT_EQ(small.points().size(), map->points().size()) << "no point is lost";
  EXPECT_LT(packed->features_after, packed->features_before);
  small.keyframes().ForEach([&](const auto& keyframe) {
    const map::Keyframe& was = map->keyframe(keyframe->id);
    EXPECT_EQ(keyframe->points.size(), keyframe->features->features.size());
    EXPECT_EQ(keyframe->features->words.size(), keyframe->points.size());
    for (std::size_t i = 0; i < keyframe->points.size(); ++i) {
      ASSERT_TRUE(keyframe->points[i]);
      // The same feature saw the same point.
      const auto at = std::ranges::find(was.points, keyframe->points[i]) - was.points.begin();
      EXPECT_EQ(keyframe->descriptors()[i], was.descriptors()[static_cast<std::size_t>(at)]);
    }
  });
  inspect::CoverageOptions coverage;
  coverage.max_tests = 5;
  const auto queries = CompareSelfQueries(*room.View(map), *room.View(packed->map), coverage);
  ASSERT_TRUE(queries.ok()) << queries.status();
  EXPECT_GE(queries->whole.found_after, queries->whole.found_before - 1);
}

TEST(Pack, SightingsThatLookTheSameGoWhereThereAreMany) {
  const Room room(5);
  const auto map = room.Map(20, 3);
  PackOptions options;
  options.max_sightings = 2;
  options.min_features = 100;
  const auto packed = Pack(*map, map->info(), options);
  ASSERT_TRUE(packed.ok()) << packed.status();
  ASSERT_TRUE(packed->map->CheckConsistency().ok());
  EXPECT_LT(packed->features_after, Pack(*map, map->info())->features_after);
  packed->map->keyframes().ForEach([&](const auto& keyframe) {
    const auto seen = std::ranges::count_if(map->keyframe(keyframe->id).points, [](PointId id) { return id.valid(); });
    EXPECT_GE(keyframe->points.size(), std::min<std::size_t>(100, static_cast<std::size_t>(seen)));
  });
  options.max_sightings = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(Pack(*map, map->info(), options).status()));
}

}  // namespace
}  // namespace cairn::care
