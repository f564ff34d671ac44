// The ideal camera that everything after undistortion works with. Pixel centres are at integer coordinates.
#pragma once

#include <Eigen/Core>

namespace cairn {

struct Pinhole {
  int width_px = 0;
  int height_px = 0;
  double fx_px = 0.0;
  double fy_px = 0.0;
  double cx_px = 0.0;
  double cy_px = 0.0;

  bool operator==(const Pinhole&) const = default;

  // A point in the camera frame (z > 0) to pixels.
  Eigen::Vector2d Project(const Eigen::Vector3d& point_c) const {
    return {fx_px * point_c.x() / point_c.z() + cx_px, fy_px * point_c.y() / point_c.z() + cy_px};
  }
  // Derivative of Project by the point.
  Eigen::Matrix<double, 2, 3> ProjectJacobian(const Eigen::Vector3d& point_c) const {
    const double iz = 1.0 / point_c.z();
    Eigen::Matrix<double, 2, 3> j;
    j << fx_px * iz, 0.0, -fx_px * point_c.x() * iz * iz, 0.0, fy_px * iz, -fy_px * point_c.y() * iz * iz;
    return j;
  }
  // The ray through a pixel, at unit depth (z = 1).
  Eigen::Vector3d Unproject(const Eigen::Vector2d& pixel) const {
    return {(pixel.x() - cx_px) / fx_px, (pixel.y() - cy_px) / fy_px, 1.0};
  }
  bool Contains(const Eigen::Vector2d& pixel, double margin_px = 0.0) const {
    return pixel.x() >= margin_px && pixel.y() >= margin_px && pixel.x() <= width_px - 1 - margin_px &&
           pixel.y() <= height_px - 1 - margin_px;
  }
  // The camera of the image reduced by 2x2 means: the pixel centre moves by a quarter of a new pixel.
  Pinhole Half() const {
    return {width_px / 2, height_px / 2, fx_px / 2, fy_px / 2, (cx_px + 0.5) / 2 - 0.5, (cy_px + 0.5) / 2 - 0.5};
  }
};

}  // namespace cairn
