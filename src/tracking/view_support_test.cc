#include "tracking/view_support.h"

#include <gtest/gtest.h>

namespace cairn::tracking {
namespace {

TEST(ViewSupport, CountsCellsThatShouldShowSeveralPoints) {
  const Pinhole pinhole{640, 480, 500.0, 500.0, 319.5, 239.5};
  ViewSupport support(pinhole);
  EXPECT_EQ(support.Share(), 0.0);
  for (int row = 0; row < 8; ++row) {
    for (int column = 0; column < 8; ++column) {
      const Eigen::Vector2d pixel(80.0 * column + 40.0, 60.0 * row + 30.0);
      for (int i = 0; i < 3; ++i) support.Expect(pixel);
      if (column < 4) support.Find(pixel);
    }
  }
  EXPECT_EQ(support.visible_cells(), 64);
  EXPECT_EQ(support.cells(), 32);
  EXPECT_NEAR(support.Share(), 0.5 - 2.0 * 0.0625, 1e-12);
}

TEST(ViewSupport, ASinglePointMayBeHidden) {
  const Pinhole pinhole{640, 480, 500.0, 500.0, 319.5, 239.5};
  ViewSupport support(pinhole);
  support.Expect({10.0, 10.0});
  support.Expect({10.0, 10.0});
  EXPECT_EQ(support.visible_cells(), 0);
  support.Expect({-5.0, 10.0});  // counts at the border
  EXPECT_EQ(support.visible_cells(), 1);
  EXPECT_EQ(support.cells(), 0);
  // Few cells say little: three of four are less than half for sure.
  EXPECT_LT(ViewSupport::ShareOf(3, 4), 0.5);
  EXPECT_GT(ViewSupport::ShareOf(48, 64), 0.5);
}

}  // namespace
}  // namespace cairn::tracking
