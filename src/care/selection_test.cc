#include "care/selection.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "care/whole_map.h"
#include "map/plausibility.h"
#include "map/testing_two_visits.h"

namespace cairn::care {
namespace {

void ExpectGood(const map::Snapshot& map) {
  EXPECT_TRUE(map.CheckConsistency().ok()) << map.CheckConsistency();
  EXPECT_TRUE(
      map::FindImplausible(map, {}, [](const map::Implausibility& what) { ADD_FAILURE() << what.message; }).ok());
}

TEST(SelectKeyframes, ASessionBecomesAMap) {
  const map::testing::TwoVisits visits = map::testing::MakeTwoVisits();
  const map::MapInfo info = NewMapInfo(visits.map->info(), "part");
  // The second session has not made the root.
  const auto part = SelectKeyframes(*visits.map, info,
                                    [&](const map::Keyframe& keyframe) { return keyframe.session == visits.second; });
  ASSERT_TRUE(part.ok()) << part.status();
  ExpectGood(**part);
  EXPECT_EQ((*part)->info().id, info.id);
  EXPECT_EQ((*part)->revision(), 1u);
  EXPECT_EQ((*part)->keyframes().size(), 5u);
  EXPECT_TRUE((*part)->components().contains(visits.shared));
  EXPECT_FALSE((*part)->components().contains(visits.alone));
  EXPECT_EQ((*part)->WorldFrom(visits.shared)->scale(), visits.map->WorldFrom(visits.shared)->scale());
  // Of those that have nothing in it nothing is said, although one of them began the component.
  EXPECT_THAT((*part)->sessions(), testing::ElementsAre(testing::Key(visits.second)));
  EXPECT_EQ((*part)->component(visits.shared).session, visits.second);
  EXPECT_THAT((*part)->components(), testing::ElementsAre(testing::Key(visits.shared)));
  EXPECT_THAT((*part)->sessions().at(visits.second).components, testing::Each(visits.shared));
  (*part)->keyframes().ForEach([&](const auto& keyframe) {
    const map::Keyframe& was = visits.map->keyframe(keyframe->id);
    EXPECT_EQ(keyframe->camera_from_map.translation(), was.camera_from_map.translation());
    EXPECT_EQ(keyframe->points, was.points) << "all that it saw is there";
  });
}

TEST(SelectKeyframes, PartsComeToTheWhole) {
  const map::testing::TwoVisits visits = map::testing::MakeTwoVisits();
  std::size_t keyframes = 0;
  for (const ComponentId id : visits.map->LiveComponents()) {
    const auto part = SelectKeyframes(*visits.map, visits.map->info(),
                                      [&](const map::Keyframe& keyframe) { return keyframe.component == id; });
    ASSERT_TRUE(part.ok()) << part.status();
    ExpectGood(**part);
    keyframes += (*part)->keyframes().size();
  }
  EXPECT_EQ(keyframes, visits.map->keyframes().size());
  EXPECT_TRUE(absl::IsFailedPrecondition(
      SelectKeyframes(*visits.map, visits.map->info(), [](const map::Keyframe&) { return false; }).status()));
}

}  // namespace
}  // namespace cairn::care
