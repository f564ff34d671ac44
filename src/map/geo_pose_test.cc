#include "map/geo_pose.h"

#include <gtest/gtest.h>

#include <cmath>

namespace cairn::map {
namespace {

// camera_from_world of one that looks along `forward` with `up` upwards, both in the world.
Quaterniond WorldFromCamera(const Vector3d& forward, const Vector3d& up) {
  Matrix3d axes;
  axes.col(2) = forward.normalized();
  axes.col(0) = forward.cross(up).normalized();  // right
  axes.col(1) = axes.col(2).cross(axes.col(0));  // down
  return Quaterniond(axes);
}

const GeoAnchor kHelsinki = {60.1699, 24.9384, 30.0, Quaterniond::Identity()};

void ExpectSameRotation(const Quaterniond& a, const Quaterniond& b, double tolerance_rad = 1e-9) {
  EXPECT_LT(a.angularDistance(b), tolerance_rad) << a.coeffs().transpose() << " and " << b.coeffs().transpose();
}

TEST(GeoPose, AxesAreForwardLeftUp) {
  // Level, looking east: the body's axes are east, north, up themselves.
  const SE3 east(WorldFromCamera(Vector3d::UnitX(), Vector3d::UnitZ()), Vector3d::Zero());
  ExpectSameRotation(GeoPoseOf(kHelsinki, east).enu_from_body, Quaterniond::Identity());
  // Looking north: turned to the left by a right angle, about up.
  const SE3 north(WorldFromCamera(Vector3d::UnitY(), Vector3d::UnitZ()), Vector3d::Zero());
  ExpectSameRotation(GeoPoseOf(kHelsinki, north).enu_from_body,
                     Quaterniond(Eigen::AngleAxisd(M_PI / 2, Vector3d::UnitZ())));
  // Looking straight down with north on top of the image: forward is down, up is north.
  const SE3 down(WorldFromCamera(-Vector3d::UnitZ(), Vector3d::UnitY()), Vector3d::Zero());
  const Quaterniond body = GeoPoseOf(kHelsinki, down).enu_from_body;
  EXPECT_LT((body * Vector3d::UnitX() + Vector3d::UnitZ()).norm(), 1e-12);
  EXPECT_LT((body * Vector3d::UnitZ() - Vector3d::UnitY()).norm(), 1e-12);
}

TEST(GeoPose, PositionsByTheAnchor) {
  // Of a world whose x axis points north: 100 m along it are 100 m to the north.
  GeoAnchor anchor = kHelsinki;
  anchor.enu_from_world = Quaterniond(Eigen::AngleAxisd(M_PI / 2, Vector3d::UnitZ()));
  const SE3 pose(WorldFromCamera(Vector3d::UnitX(), Vector3d::UnitZ()), Vector3d(100.0, 0.0, 2.0));
  const GeoPose found = GeoPoseOf(anchor, pose);
  // A degree of the meridian there is a (1 - e2) (1 - e2 sin2)^(-3/2) pi/180 = 111415.17 m long.
  EXPECT_NEAR(found.position.latitude_deg, anchor.latitude_deg + 100.0 / 111415.17, 1e-8);
  EXPECT_NEAR(found.position.longitude_deg, anchor.longitude_deg, 1e-9);
  EXPECT_NEAR(found.position.height_m, 32.0, 2e-3);
  ExpectSameRotation(found.enu_from_body, Quaterniond(Eigen::AngleAxisd(M_PI / 2, Vector3d::UnitZ())), 1e-4);
  EXPECT_LT((WorldFromGeodetic(anchor, found.position) - pose.translation()).norm(), 1e-6);
}

// Far from the anchor up is another direction: a camera that is level there is level in its own frame.
TEST(GeoPose, OrientationIsThatAtTheCamera) {
  const GeoPosition there = {60.4, 24.9384, 30.0};  // 25 km further north
  const Quaterniond enu_from_there = EnuAtFromEnu(there, PositionOf(kHelsinki)).conjugate();
  const SE3 pose(enu_from_there * WorldFromCamera(Vector3d::UnitX(), Vector3d::UnitZ()),
                 WorldFromGeodetic(kHelsinki, there));
  const GeoPose found = GeoPoseOf(kHelsinki, pose);
  ExpectSameRotation(found.enu_from_body, Quaterniond::Identity());
  EXPECT_NEAR(found.position.latitude_deg, there.latitude_deg, 1e-10);
  EXPECT_GT(pose.rotation().angularDistance(WorldFromCamera(Vector3d::UnitX(), Vector3d::UnitZ())), 0.003);
}

TEST(GeoPose, HeadingsAreClockwiseFromNorth) {
  const Vector3d x = Vector3d::UnitX(), y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  ExpectSameRotation(EnuFromWorld(z, x, 90.0), Quaterniond::Identity());
  EXPECT_LT((EnuFromWorld(z, x, 0.0) * x - y).norm(), 1e-12) << "to the north";
  EXPECT_LT((EnuFromWorld(z, x, 0.0) * y + x).norm(), 1e-12) << "y is to the left of x: west";
  // The world of a camera: y down, z ahead.
  const Quaterniond camera_world = EnuFromWorld(-y, z, 180.0);
  EXPECT_LT((camera_world * z + y).norm(), 1e-12) << "to the south";
  EXPECT_LT((camera_world * y + z).norm(), 1e-12);
  EXPECT_LT((camera_world * x + x).norm(), 1e-12) << "its right is west";
}

}  // namespace
}  // namespace cairn::map
