#include "map/plausibility.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "map/edit.h"
#include "map/testing_map.h"

namespace cairn::map {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

std::vector<std::string> Found(const Snapshot& map) {
  std::vector<std::string> found;
  const absl::Status status = FindImplausible(map, {}, [&](const Implausibility& what) {
    found.push_back(absl::StrCat(what.kind, " ", what.id));
    EXPECT_FALSE(what.message.empty());
  });
  EXPECT_TRUE(status.ok()) << status;
  return found;
}

TEST(Plausibility, AMapWithNoiseMakesSense) {
  EXPECT_THAT(Found(*testing::MakeMap(1, 6, 200, 1.0).snapshot), IsEmpty());
}

TEST(Plausibility, ACameraThatLooksAwayIsFound) {
  const testing::TestMap world = testing::MakeMap(2, 6, 200, 1.0);
  const SE3 turned(ExpSO3(Vector3d(0, M_PI, 0)), Vector3d::Zero());
  Edit edit(world.snapshot);
  edit.SetPose(KeyframeId(3), turned * world.poses[2]);
  const auto map = world.snapshot->Apply(edit.Finish("turn"));
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_THAT(Found(**map), ElementsAre("keyframes 3"));
}

TEST(Plausibility, ACameraElsewhereIsFound) {
  const testing::TestMap world = testing::MakeMap(3, 6, 200, 1.0);
  Edit edit(world.snapshot);
  edit.SetPose(KeyframeId(5), SE3(ExpSO3(Vector3d(0, 0.2, 0)), Vector3d::Zero()) * world.poses[4]);
  const auto map = world.snapshot->Apply(edit.Finish("turn"));
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_THAT(Found(**map), ElementsAre("keyframes 5"));
}

TEST(Plausibility, AComponentInTwoPartsIsFound) {
  // A keyframe that shares nothing with the others, put into their component.
  const testing::TestMap world = testing::MakeMap(4, 4, 200);
  Random random(5);
  std::vector<std::size_t> visible;
  Edit edit(world.snapshot);
  Keyframe alone = testing::MakeKeyframe(world, 1, 0.0, random, &visible);
  alone.component = world.snapshot->keyframe(KeyframeId(1)).component;
  edit.AddKeyframe(std::move(alone));
  const auto map = world.snapshot->Apply(edit.Finish("alone"));
  ASSERT_TRUE(map.ok()) << map.status();
  EXPECT_THAT(Found(**map), ElementsAre("components 1"));
}

TEST(Plausibility, OptionsAreChecked) {
  PlausibilityOptions options;
  options.max_wrong_share = 2.0;
  EXPECT_FALSE(FindImplausible(*testing::MakeMap(1, 2, 20).snapshot, options, [](const Implausibility&) {}).ok());
}

}  // namespace
}  // namespace cairn::map
