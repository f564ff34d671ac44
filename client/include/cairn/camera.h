/// \file
/// The calibration of a camera: where a ray of light becomes a pixel.
#pragma once

#include <vector>

#include "cairn/export.h"
#include "cairn/status.h"

CAIRN_BEGIN_NAMESPACE

/// How a lens bends light. With x = X/Z, y = Y/Z and r the distance from the axis:
enum class CameraModel {
  kPinhole,           ///< not at all; no coefficients
  kRadialTangential,  ///< k1 k2 p1 p2 [k3 [k4 k5 k6]], as OpenCV and ROS ("plumb_bob", "rational_polynomial")
  kKannalaBrandt,     ///< k1 k2 k3 k4, as OpenCV's fisheye ("equidistant")
  kFov,               ///< omega in radians (Devernay and Faugeras 2001), as TUM monoVO and PTAM
};

/// Of the raw image, in its pixels. Pixel centres are at integer coordinates: where they are at (0.5, 0.5), as in
/// COLMAP, subtract 0.5 from the principal point.
struct Camera {
  CameraModel model = CameraModel::kPinhole;  ///< the lens
  int width_px = 0;                           ///< of the images
  int height_px = 0;                          ///< of the images
  double fx_px = 0.0;                         ///< focal length along a row
  double fy_px = 0.0;                         ///< focal length along a column
  double cx_px = 0.0;                         ///< column of the principal point
  double cy_px = 0.0;                         ///< row of the principal point
  std::vector<double> distortion;  ///< as many coefficients as the model has; kRadialTangential: 0, 4, 5 or 8

  /// kInvalidArgument if a size or focal length is not positive, a number is not finite, the principal point is far
  /// from the image, or the coefficients do not fit the model.
  CAIRN_API absl::Status Validate() const noexcept;
};

CAIRN_END_NAMESPACE
