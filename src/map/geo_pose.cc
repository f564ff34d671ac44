#include "map/geo_pose.h"

#include <cmath>
#include <numbers>

namespace cairn::map {

Quaterniond CameraFromBody() {
  Matrix3d camera_from_body;
  camera_from_body.col(0) = Vector3d::UnitZ();   // forward
  camera_from_body.col(1) = -Vector3d::UnitX();  // left
  camera_from_body.col(2) = -Vector3d::UnitY();  // up
  return Quaterniond(camera_from_body);
}

GeoPosition PositionOf(const GeoAnchor& anchor) { return {anchor.latitude_deg, anchor.longitude_deg, anchor.height_m}; }

GeoAnchor AnchorAt(const GeoPosition& position, const Quaterniond& enu_from_world) {
  return {position.latitude_deg, position.longitude_deg, position.height_m, enu_from_world.normalized()};
}

Quaterniond EnuFromWorld(const Vector3d& up, const Vector3d& ahead, double heading_deg) {
  const double heading = heading_deg * std::numbers::pi / 180.0;
  Matrix3d axes_in_world, axes_in_enu;  // ahead, to the left, up
  axes_in_world << ahead, up.cross(ahead), up;
  axes_in_enu << std::sin(heading), -std::cos(heading), 0.0,  //
      std::cos(heading), std::sin(heading), 0.0,              //
      0.0, 0.0, 1.0;
  return Quaterniond(Matrix3d(axes_in_enu * axes_in_world.transpose())).normalized();
}

GeoPose GeoPoseOf(const GeoAnchor& anchor, const SE3& world_from_camera) {
  const GeoPosition origin = PositionOf(anchor);
  GeoPose pose;
  pose.position = GeodeticFromEnu(anchor.enu_from_world * world_from_camera.translation(), origin);
  pose.enu_from_body =
      (EnuAtFromEnu(pose.position, origin) * anchor.enu_from_world * world_from_camera.rotation() * CameraFromBody())
          .normalized();
  return pose;
}

Vector3d WorldFromGeodetic(const GeoAnchor& anchor, const GeoPosition& position) {
  return anchor.enu_from_world.conjugate() * EnuFromGeodetic(position, PositionOf(anchor));
}

}  // namespace cairn::map
