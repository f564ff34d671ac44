#include "care/merging.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "care/testing_room.h"
#include "care/whole_map.h"
#include "map/plausibility.h"

namespace cairn::care {
namespace {

using testing::Room;

TEST(MergeMaps, WhatOverlapsBecomesOneComponentInTheFirstOnesFrame) {
  const Room room(5);
  const auto first = room.Map(14, 1);
  const Sim3 other(ExpSO3(Vector3d(0.2, 0.4, -0.1)), Vector3d(3, -1, 2), 1.8);
  const auto second = testing::Moved(room.Map(12, 2), other);
  const auto merged = MergeMaps(first, *second, room.words, {}, 7);
  ASSERT_TRUE(merged.ok()) << merged.status();
  ASSERT_NE(merged->map, nullptr);
  ASSERT_EQ(merged->attempts.size(), 1u);
  EXPECT_EQ(merged->attempts[0].component, ComponentId(1));
  EXPECT_EQ(merged->attempts[0].joined_into, ComponentId(1));
  EXPECT_NEAR(merged->attempts[0].scale, 1.0 / 1.8, 0.01);
  const map::Snapshot& map = *merged->map;
  EXPECT_EQ(map.keyframes().size(), 26u);
  EXPECT_EQ(map.LiveComponents().size(), 1u);
  EXPECT_EQ(map.components().at(ComponentId(2)).joined->joined_unix_ns, 7);
  // In a file of its own, which begins with it, it was so from the first revision on.
  EXPECT_EQ(AsOneChange(map, "merge").components[1].joined->revision, 1u);
  EXPECT_EQ(map.sessions().size(), 2u);
  EXPECT_EQ(map.cameras().size(), 1u) << "both are from the same camera";
  ASSERT_TRUE(map.CheckConsistency().ok()) << map.CheckConsistency();
  EXPECT_TRUE(
      map::FindImplausible(map, {}, [](const map::Implausibility& what) { ADD_FAILURE() << what.message; }).ok());
  // The second one's cameras are where they were in the room, and most points of both have become one.
  const std::vector<SE3> truth = tracking::testing_world::PathInRoom(Vector3d::Zero(), 12);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const map::Keyframe& keyframe = map.keyframe(KeyframeId(static_cast<KeyframeId::Value>(15 + i)));
    EXPECT_LT(tracking::testing_world::CenterError(keyframe.camera_from_map, truth[i]), 0.03) << i;
  }
  EXPECT_LT(map.points().size(), 0.7 * static_cast<double>(first->points().size() + second->points().size()));
}

TEST(MergeMaps, OtherPlacesAreNotJoined) {
  const Room room(5), elsewhere(6);
  const auto first = room.Map(12, 1);
  const auto second = elsewhere.Map(10, 2);
  const auto apart = MergeMaps(first, *second, room.words, {}, 0);
  ASSERT_TRUE(apart.ok()) << apart.status();
  EXPECT_EQ(apart->map, nullptr);
  ASSERT_EQ(apart->attempts.size(), 1u);
  EXPECT_EQ(apart->attempts[0].keyframes, 10);
  EXPECT_FALSE(apart->attempts[0].joined_into);
  MergeOptions options;
  options.allow_apart = true;
  const auto beside = MergeMaps(first, *second, room.words, options, 0);
  ASSERT_TRUE(beside.ok()) << beside.status();
  ASSERT_NE(beside->map, nullptr);
  EXPECT_EQ(beside->map->LiveComponents().size(), 2u);
  // Words of the second vocabulary have become those of the first.
  const map::Keyframe& added = beside->map->keyframe(KeyframeId(13));
  EXPECT_EQ(added.features->words, room.words->LookupAll(added.descriptors()));
}

// A merged map calls the second one's keyframes otherwise: they are known by what they are.
TEST(MergeMaps, WhatWasMergedBeforeIsRefused) {
  const Room room(5);
  const auto first = room.Map(14, 1), second = room.Map(12, 2);
  const auto merged = MergeMaps(first, *second, room.words, {}, 0);
  ASSERT_TRUE(merged.ok() && merged->map != nullptr);
  for (const auto& [a, b] : {std::pair(merged->map, second), std::pair(second, merged->map)}) {
    const absl::Status twice = MergeMaps(a, *b, room.words, {}, 0).status();
    EXPECT_TRUE(absl::IsFailedPrecondition(twice)) << twice;
    EXPECT_THAT(std::string(twice.message()), ::testing::HasSubstr("in common"));
  }
}

TEST(MergeMaps, WhereOnTheEarthTheSecondIsIsKept) {
  const Room room(5);
  const auto first = room.Map(14, 1), second = room.Map(12, 2);
  map::Edit edit(second);
  map::MapInfo info = edit.info();
  info.geo_anchor = map::GeoAnchor{48.1, 11.5, 520.0, Quaterniond::Identity()};
  edit.SetInfo(info);
  const auto anchored = *second->Apply(edit.Finish("align"));
  const auto merged = MergeMaps(first, *anchored, room.words, {}, 0);
  ASSERT_TRUE(merged.ok() && merged->map != nullptr) << merged.status();
  ASSERT_TRUE(merged->map->info().geo_anchor);
  EXPECT_EQ(merged->map->info().geo_anchor->latitude_deg, 48.1);

  // What the second is joined to is not aligned in it, though the first is: two worlds that may be two.
  map::Edit aligned(first);
  map::Component component = first->components().at(ComponentId(1));
  component.world_from_component = Sim3();
  aligned.PutComponent(component);
  const auto in_a_world = MergeMaps(*first->Apply(aligned.Finish("align")), *anchored, room.words, {}, 0);
  ASSERT_TRUE(in_a_world.ok() && in_a_world->map != nullptr) << in_a_world.status();
  EXPECT_FALSE(in_a_world->map->info().geo_anchor);
}

TEST(MergeMaps, CopiesAndUnlikeFeaturesAreRefused) {
  const Room room(5);
  const auto map = room.Map(6, 1);
  const absl::Status copy = MergeMaps(map, *map, room.words, {}, 0).status();
  EXPECT_TRUE(absl::IsFailedPrecondition(copy));
  EXPECT_THAT(std::string(copy.message()), ::testing::HasSubstr("in common"));
  map::MapInfo info = map->info();
  info.orb.num_features += 1;
  const auto other = *map::Snapshot::Empty(info)->Apply(AsOneChange(*room.Map(6, 3), "other"));
  EXPECT_TRUE(absl::IsFailedPrecondition(MergeMaps(map, *other, room.words, {}, 0).status()));
  EXPECT_TRUE(absl::IsFailedPrecondition(MergeMaps(map, *room.Map(6, 3), nullptr, {}, 0).status()));
  EXPECT_TRUE(
      absl::IsCancelled(MergeMaps(map, *room.Map(6, 3), room.words, {}, 0, [](int, int) { return false; }).status()));
}

}  // namespace
}  // namespace cairn::care
