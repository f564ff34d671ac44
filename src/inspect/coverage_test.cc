#include "inspect/coverage.h"

#include <gtest/gtest.h>

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
  for (const CoverageCell& cell : coverage->cells) tests += cell.tests;
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
  EXPECT_EQ(coverage->cell_size, 0.5);
  const CoverageCell aside = CellOf(*coverage, Vector3d(1.01, 0.0, -1.5));
  bool told = false;
  for (const std::string& warning : coverage->warnings) {
    told |= warning.find(absl::StrCat("cell ", aside.x, ", ", aside.y, " ")) != std::string::npos;
  }
  EXPECT_TRUE(told);
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
