#include "geometry/pose_spread.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

double Distance(const SE3& a, const SE3& b) { return (a.Inverse() * b).Log().norm(); }

SE3 Pose(double x, double y, double z, double rx, double ry, double rz) {
  Vector6d increment;
  increment << x, y, z, rx, ry, rz;
  return SE3::Exp(increment);
}

const SE3 kPose = Pose(0.4, -0.1, 0.2, 0.1, 0.3, -0.2);
const SE3 kPredicted = Pose(1.0, 0.2, 0.1, 0.2, 0.5, -0.1);
const SE3 kActual = Pose(1.1, 0.1, 0.3, 0.3, 0.4, 0.1);

TEST(SpreadDifference, LeavesTheBeginningAndReachesTheEnd) {
  EXPECT_LT(Distance(SpreadDifference(kPose, kPredicted, kActual, 0.0), kPose), 1e-12);
  EXPECT_LT(Distance(SpreadDifference(kPredicted, kPredicted, kActual, 1.0), kActual), 1e-12);
}

TEST(SpreadDifference, ChangesNothingWhereThePredictionHolds) {
  EXPECT_LT(Distance(SpreadDifference(kPose, kPredicted, kPredicted, 0.7), kPose), 1e-12);
}

TEST(SpreadDifference, TakesItsShareOfTheTranslationAndOfTheAngle) {
  const SE3 half = SpreadDifference(kPose, kPredicted, kActual, 0.5);
  const Vector3d shift = kActual.translation() - kPredicted.translation();
  EXPECT_LT((half.translation() - kPose.translation() - 0.5 * shift).norm(), 1e-12);
  const double whole_rad = kPredicted.rotation().angularDistance(kActual.rotation());
  EXPECT_NEAR(half.rotation().angularDistance(kPose.rotation()), 0.5 * whole_rad, 1e-12);
}

}  // namespace
}  // namespace cairn
