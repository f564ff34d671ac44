// A pinhole camera from what it saw: points whose places in the camera frame are known, and their pixels.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "geometry/pinhole.h"

namespace cairn {

struct SeenPoint {
  Eigen::Vector3d point_c;  // camera frame; only points in front count
  Eigen::Vector2d pixel;
};

struct PinholeFit {
  Pinhole camera;  // the size: what holds all pixels, and the principal point in its middle
  double median_error_px = 0.0;
};

// u = fx x/z + cx and v = fy y/z + cy are linear in the camera: least squares, repeated without what is beyond three
// times the median error. None if there are fewer than 20 points, or they do not tell the camera (all in one
// direction), or no camera saw them so.
std::optional<PinholeFit> FitPinhole(const std::vector<SeenPoint>& seen);

}  // namespace cairn
