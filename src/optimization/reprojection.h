// The reprojection error of a map point in a pinhole camera, and its derivatives: the residual of every feature-based
// bundle adjustment here (eq. "reproj_error", Sec. V-C of "Loosely-Coupled Semi-Direct Monocular SLAM").
//
// residual = project(camera_from_map * point) - pixel, in pixels. Increments of the pose act from the left in the order
// of geometry/se3.h: Exp(x) camera_from_map with x = (translation, rotation), so that d(point_c) = x_t - [point_c] x_r.
#pragma once

#include <cmath>

#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::optimization {

using Matrix26d = Eigen::Matrix<double, 2, 6>;
using Matrix23d = Eigen::Matrix<double, 2, 3>;

// Chi-square at 95 % for the two dimensions of a pixel: the border between inlier and outlier of whitened residuals.
inline constexpr double kChiSquarePixel95 = 5.991;

// A point in the camera frame must be in front of the camera for a residual to exist.
inline bool InFront(const Vector3d& point_c) { return point_c.z() > 1e-9; }

// In pixels. The point must be in front of the camera.
inline Vector2d ReprojectionResidual(const Pinhole& pinhole, const Vector3d& point_c, const Vector2d& pixel) {
  return pinhole.Project(point_c) - pixel;
}

// Derivative of the residual by the left increment of camera_from_map.
inline Matrix26d ReprojectionByPose(const Pinhole& pinhole, const Vector3d& point_c) {
  const double iz = 1.0 / point_c.z();
  const double x = point_c.x() * iz, y = point_c.y() * iz;  // on the plane z = 1
  const double fx = pinhole.fx_px, fy = pinhole.fy_px;
  Matrix26d j;
  // [ProjectJacobian, -ProjectJacobian [point_c]x], multiplied out.
  j << fx * iz, 0.0, -fx * x * iz, -fx * x * y, fx * (1.0 + x * x), -fx * y,  //
      0.0, fy * iz, -fy * y * iz, -fy * (1.0 + y * y), fy * x * y, fy * x;
  return j;
}

// Derivative of the residual by the logarithm of both focal lengths: as far as the pixel is from the principal point.
inline Vector2d ReprojectionByLogFocal(const Pinhole& pinhole, const Vector3d& point_c) {
  return pinhole.Project(point_c) - Vector2d(pinhole.cx_px, pinhole.cy_px);
}

// Derivative of the residual by the point in the map frame.
inline Matrix23d ReprojectionByPoint(const Pinhole& pinhole, const Matrix3d& camera_from_map_rotation,
                                     const Vector3d& point_c) {
  return pinhole.ProjectJacobian(point_c) * camera_from_map_rotation;
}

// Huber's loss on the squared whitened residual: its value, and the weight of the residual in the normal equations.
struct HuberLoss {
  double threshold = 0.0;  // of the whitened residual's norm

  double Value(double chi2) const {
    const double limit = threshold * threshold;
    return chi2 <= limit ? chi2 : 2.0 * threshold * std::sqrt(chi2) - limit;
  }
  double Weight(double chi2) const { return chi2 <= threshold * threshold ? 1.0 : threshold / std::sqrt(chi2); }
};

}  // namespace cairn::optimization
