#include "geometry/lens_correction.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

const Pinhole kPinhole{640, 480, 500.0, 510.0, 319.0, 242.0};

TEST(LensCorrectionTest, IdealUndoesWhatTheLensDoes) {
  const LensCorrection lens{0.98, 0.03, -0.02};
  for (const Eigen::Vector2d& ideal : {Eigen::Vector2d(10.0, 20.0), Eigen::Vector2d(319.0, 242.0),
                                       Eigen::Vector2d(600.0, 100.0), Eigen::Vector2d(320.0, 470.0)}) {
    const Eigen::Vector3d ray = kPinhole.Unproject(ideal);
    const double r2 = ray.head<2>().squaredNorm(), g = 0.98 * (1.0 + 0.03 * r2 - 0.02 * r2 * r2);
    const Eigen::Vector2d seen(319.0 + 500.0 * g * ray.x(), 242.0 + 510.0 * g * ray.y());
    const auto back = lens.Ideal(kPinhole, seen);
    ASSERT_TRUE(back.has_value());
    EXPECT_LT((*back - ideal).norm(), 1e-6);
  }
}

TEST(LensCorrectionTest, NoCorrectionMovesNothing) {
  EXPECT_LT(LensCorrection().ShiftOver(kPinhole).max_px, 1e-7);
  const LensCorrection::Shift shift = LensCorrection{1.01, 0.0, 0.0}.ShiftOver(kPinhole);
  EXPECT_NEAR(shift.max_px, 0.01 / 1.01 * Eigen::Vector2d(320.0, 242.0).norm(), 0.05);  // the farthest corner
  EXPECT_LT(shift.rms_px, shift.max_px);
}

TEST(LensCorrectionTest, WhatIsNoLensIsRefused) {
  EXPECT_TRUE((LensCorrection{1.1, 0.1, 0.1}).Validate().ok());
  EXPECT_FALSE((LensCorrection{0.0, 0.0, 0.0}).Validate().ok());
  EXPECT_FALSE((LensCorrection{1.0, std::numeric_limits<double>::quiet_NaN(), 0.0}).Validate().ok());
}

}  // namespace
}  // namespace cairn
