// Cameras as the web names them: COLMAP's models, with its parameters in its order and its pixel centres, which lie at
// (0.5, 0.5) and become Cairn's at (0, 0).
//
//   {"model": "OPENCV", "params": [fx, fy, cx, cy, k1, k2, p1, p2], "width": 640, "height": 480}
#pragma once

#include <string>

#include "base/status.h"
#include "geometry/camera.h"

namespace cairn::server {

// SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, FOV. Without a size the camera
// has width and height 0: those of its image. InvalidArgument says what is wrong. Not validated yet.
absl::StatusOr<Camera> CameraFromJson(const std::string& json);

}  // namespace cairn::server
