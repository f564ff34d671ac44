// From the world frame of a map to the earth and back, by the map's geographic anchor.
#pragma once

#include "geometry/geodesy.h"
#include "map/entities.h"

namespace cairn::map {

// Where a camera is on the earth, as OGC GeoPose 1.0 (21-056r11, "Basic-Quaternion") says it: its axes are x forward,
// y to the left, z up, and the rotation takes them to east, north, up at its own position.
struct GeoPose {
  GeoPosition position;
  Quaterniond enu_from_body = Quaterniond::Identity();
};

// Those axes of a camera, which by itself looks along +z with x to the right and y down: camera_from_body.
Quaterniond CameraFromBody();

GeoPosition PositionOf(const GeoAnchor& anchor);
// The origin of the world is at `position`.
GeoAnchor AnchorAt(const GeoPosition& position, const Quaterniond& enu_from_world);

// enu_from_world of a world whose axis `up` points upwards and whose axis `ahead` points to `heading_deg`, clockwise
// from true north. Both of unit length, at a right angle.
Quaterniond EnuFromWorld(const Vector3d& up, const Vector3d& ahead, double heading_deg);

// Of a world in metres.
GeoPose GeoPoseOf(const GeoAnchor& anchor, const SE3& world_from_camera);
Vector3d WorldFromGeodetic(const GeoAnchor& anchor, const GeoPosition& position);

}  // namespace cairn::map
