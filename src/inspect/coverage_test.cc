#include "inspect/coverage.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "absl/strings/match.h"
#include "absl/strings/str_format.h"
#include "map/edit.h"
#include "tracking/testing_world.h"

namespace cairn::inspect {
namespace {

namespace world = tracking::testing_world;

// A room whose far wall is seen by ten keyframes, and a side of it by two that stand at one place.
class CoverageOfARoom : public ::testing::Test {
 protected:
  CoverageOfARoom() {
    Random random(11);
    world::AddRoom(Vector3d::Zero(), 4000, random, &room_);
    std::vector<SE3> poses = world::PathInRoom(Vector3d::Zero(), 10);
    poses.push_back(world::Look(Vector3d(1.0, 0.0, -1.5), 1.45));
    poses.push_back(world::Look(Vector3d(1.02, 0.0, -1.5), 1.45));
    const auto vocabulary = world::TrainVocabulary(room_);
    view_ = *tracking::MapView::Create(world::BuildMap(room_, poses, *vocabulary, {}, random), vocabulary);
  }
  world::World room_;
  std::shared_ptr<const tracking::MapView> view_;
};

TEST_F(CoverageOfARoom, ViewsThatNoOtherSharesAreNotFound) {
  const auto coverage = MeasureCoverage(*view_);
  ASSERT_TRUE(coverage.ok()) << coverage.status();
  // All but the root of the tree.
  ASSERT_EQ(coverage->tests.size(), 11u);
  EXPECT_EQ(coverage->not_tested, 1);
  int found_on_path = 0;
  for (const CoverageTest& test : coverage->tests) {
    if (test.keyframe.value() > 10) {
      EXPECT_EQ(test.left_out, 1);  // they share nearly everything
      EXPECT_EQ(test.result, CoverageResult::kMissed) << test.inliers;
    } else {
      found_on_path += test.result == CoverageResult::kFound ? 1 : 0;
    }
  }
  EXPECT_GE(found_on_path, 8);
  int tests = 0;
  ASSERT_EQ(coverage->grounds.size(), 1u);
  for (const CoverageCell& cell : coverage->grounds[0].cells) tests += cell.tests;
  EXPECT_EQ(tests, 11);
  EXPECT_NEAR(coverage->share, found_on_path / 11.0, 1e-9);
  // The map itself is as it was.
  EXPECT_EQ(view_->map().keyframes().size(), 12u);
}

TEST_F(CoverageOfARoom, CellsAreWarnedOf) {
  CoverageOptions options;
  options.cell_size = 0.5;
  const auto coverage = MeasureCoverage(*view_, options);
  ASSERT_TRUE(coverage.ok()) << coverage.status();
  ASSERT_EQ(coverage->grounds.size(), 1u);
  const CoverageGround& ground = coverage->grounds[0];
  EXPECT_EQ(ground.cell_size, 0.5);
  const CoverageCell aside = ground.CellOf(Vector3d(1.01, 0.0, -1.5));
  bool told = false;
  for (const std::string& warning : coverage->warnings) {
    for (const CoverageCell& cell : ground.cells) {
      if (cell.x != aside.x || cell.y != aside.y) continue;
      told |= absl::StrContains(
          warning, absl::StrFormat("around %.2f %.2f %.2f", cell.center.x(), cell.center.y(), cell.center.z()));
      // It is not aligned: the largest extent, and a cell's centre is in it.
      EXPECT_TRUE(ground.right_name.empty());
      const CoverageCell at = ground.CellOf(cell.center);
      EXPECT_EQ(std::pair(at.x, at.y), std::pair(cell.x, cell.y));
    }
  }
  EXPECT_TRUE(told);
}

TEST_F(CoverageOfARoom, OfAnAlignedMapIsInTheWorld) {
  map::Edit edit(view_->snapshot());
  // Cameras look along the room with y down: turned so that the world's z points upwards, and to the side by 30
  // degrees.
  const Quaterniond upright(Eigen::AngleAxisd(-M_PI / 2, Vector3d::UnitX()));
  const Quaterniond aside(Eigen::AngleAxisd(M_PI / 6, Vector3d::UnitZ()));
  map::Component component = edit.component(view_->map().LiveComponents()[0]);
  component.world_from_component = Sim3(aside * upright, Vector3d(100, -50, 3), 2.0);
  edit.PutComponent(component);
  const auto aligned = view_->After(edit.Finish("align"));
  ASSERT_TRUE(aligned.ok()) << aligned.status();
  const auto coverage = MeasureCoverage(**aligned);
  ASSERT_TRUE(coverage.ok()) << coverage.status();
  ASSERT_EQ(coverage->grounds.size(), 1u);
  const CoverageGround& ground = coverage->grounds[0];
  EXPECT_TRUE(ground.in_world);
  EXPECT_EQ(ground.right_name, "x");
  EXPECT_EQ(ground.ahead_name, "y");
  EXPECT_EQ(ground.right, Vector3d::UnitX());
  EXPECT_EQ(ground.ahead, Vector3d::UnitY());
  for (const CoverageTest& test : coverage->tests) {
    const CoverageCell at = ground.CellOf(test.placed_from_camera.translation());
    const auto cell = std::ranges::find_if(ground.cells, [&](const auto& c) { return c.x == at.x && c.y == at.y; });
    ASSERT_NE(cell, ground.cells.end());
    const Vector3d off = cell->center - test.placed_from_camera.translation();
    EXPECT_LE(std::abs(off.x()), 0.5 * ground.cell_size);
    EXPECT_LE(std::abs(off.y()), 0.5 * ground.cell_size);
    EXPECT_LT(std::abs(off.z()), 1.0);
  }
}

// Two rooms that nothing links, the one of them in the world: metres and map units are not told in one breath.
TEST(CoverageOfTwoComponents, EachHasItsOwnGround) {
  Random random(12);
  world::World rooms;
  const Vector3d elsewhere(200.0, 0.0, 0.0);
  world::AddRoom(Vector3d::Zero(), 4000, random, &rooms);
  world::AddRoom(elsewhere, 4000, random, &rooms);
  std::vector<SE3> poses = world::PathInRoom(Vector3d::Zero(), 6);
  for (const SE3& pose : world::PathInRoom(elsewhere, 9)) poses.push_back(pose);
  const auto vocabulary = world::TrainVocabulary(rooms);
  const auto view =
      *tracking::MapView::Create(world::BuildMap(rooms, poses, *vocabulary, {}, random, 1000000, {6}), vocabulary);
  const std::vector<ComponentId> components = view->map().LiveComponents();
  ASSERT_EQ(components.size(), 2u);

  const auto apart = MeasureCoverage(*view);
  ASSERT_TRUE(apart.ok()) << apart.status();
  ASSERT_EQ(apart->grounds.size(), 2u);
  EXPECT_EQ(apart->grounds[0].tests, 8);  // most tests first
  EXPECT_EQ(apart->grounds[1].tests, 5);

  constexpr double kScale = 50.0;
  map::Edit edit(view->snapshot());
  map::Component component = edit.component(components[0]);
  component.world_from_component = Sim3(Quaterniond::Identity(), Vector3d(3, 4, 5), kScale);
  edit.PutComponent(component);
  const auto aligned = view->After(edit.Finish("align"));
  ASSERT_TRUE(aligned.ok()) << aligned.status();
  const auto coverage = MeasureCoverage(**aligned);
  ASSERT_TRUE(coverage.ok()) << coverage.status();
  ASSERT_EQ(coverage->grounds.size(), 2u);
  const CoverageGround &in_world = coverage->grounds[0], &own = coverage->grounds[1];
  EXPECT_TRUE(in_world.in_world);
  EXPECT_FALSE(own.in_world);
  EXPECT_EQ(in_world.components, std::vector<ComponentId>{components[0]});
  EXPECT_EQ(own.components, std::vector<ComponentId>{components[1]});
  // The size of a cell comes from what is in its own frame.
  EXPECT_NEAR(in_world.cell_size, kScale * apart->grounds[1].cell_size, 1e-6 * in_world.cell_size);
  EXPECT_EQ(own.cell_size, apart->grounds[0].cell_size);
  EXPECT_EQ(own.right, apart->grounds[0].right);
  EXPECT_EQ(in_world.tests + own.tests, static_cast<int>(coverage->tests.size()));
}

TEST_F(CoverageOfARoom, ASampleAndAnEndOnRequest) {
  CoverageOptions options;
  options.max_tests = 4;
  EXPECT_EQ(MeasureCoverage(*view_, options)->tests.size(), 3u);  // one of them is the root
  const auto ended = MeasureCoverage(*view_, {}, [](int done, int) { return done < 3; });
  ASSERT_TRUE(ended.ok()) << ended.status();
  EXPECT_EQ(ended->tests.size(), 2u);
  options.max_tests = 0;
  EXPECT_TRUE(absl::IsInvalidArgument(MeasureCoverage(*view_, options).status()));
}

}  // namespace
}  // namespace cairn::inspect
