// Cameras with lens distortion: how a point in the camera frame (x right, y down, z forward) becomes a pixel of the raw
// image, and back. Pixel centres are at integer coordinates. After undistortion everything uses geometry/pinhole.h.
//
// With x = X/Z, y = Y/Z, r^2 = x^2 + y^2 and (u, v) = (fx x_d + cx, fy y_d + cy):
//   pinhole            (x_d, y_d) = (x, y)
//   radial_tangential  k1 k2 p1 p2 [k3 [k4 k5 k6]], the order of OpenCV and ROS (Brown 1966; OpenCV, module calib3d):
//                      x_d = x g + 2 p1 x y + p2 (r^2 + 2 x^2),  y_d = y g + p1 (r^2 + 2 y^2) + 2 p2 x y,
//                      g = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6)
//   kannala_brandt     k1 k2 k3 k4 (Kannala, Brandt, "A generic camera model...", PAMI 2006, as OpenCV's fisheye):
//                      theta = angle to the axis, theta_d = theta (1 + k1 theta^2 + ... + k4 theta^8), along (x, y) / r
//   fov                omega in radians (Devernay, Faugeras, "Straight lines have to be straight", MVA 2001; PTAM, TUM
//   monoVO):
//                      r_d = atan(2 r tan(omega / 2)) / omega, along (x, y) / r
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "geometry/pinhole.h"

namespace cairn {

enum class CameraModel { kPinhole, kRadialTangential, kKannalaBrandt, kFov };

// "pinhole", "radial_tangential", "kannala_brandt", "fov": the names in camera.yaml and in the map file.
absl::string_view CameraModelName(CameraModel model);
absl::StatusOr<CameraModel> CameraModelFromName(absl::string_view name);

struct Camera {
  CameraModel model = CameraModel::kPinhole;
  int width_px = 0;
  int height_px = 0;
  double fx_px = 0.0;
  double fy_px = 0.0;
  double cx_px = 0.0;
  double cy_px = 0.0;
  std::vector<double> distortion;  // as listed above; radial_tangential takes 0, 4, 5 or 8 of them

  bool operator==(const Camera&) const = default;

  static Camera FromPinhole(const Pinhole& pinhole);

  // InvalidArgument if a size or focal length is not positive, a number is not finite, the principal point is outside a
  // generous surrounding of the image, or the number of coefficients does not fit the model.
  absl::Status Validate() const;

  // True if no light ray is bent: pinhole, or all coefficients zero.
  bool IsUndistorted() const;
  // The intrinsics without the distortion.
  Pinhole Intrinsics() const { return {width_px, height_px, fx_px, fy_px, cx_px, cy_px}; }
  // fx, fy, cx, cy and then the distortion coefficients.
  int NumParameters() const { return 4 + static_cast<int>(distortion.size()); }

  // The pixel of a point in the camera frame. Nothing if the model does not image the point: behind the camera (beyond
  // 180 degrees for kannala_brandt), or so far out that the distortion polynomial has turned back. The pixel may lie
  // outside the image. Jacobians, each may be null: of the pixel by the point, 2x3, in px per unit of length; of the
  // pixel by the parameters in the order of NumParameters(), 2xN.
  std::optional<Eigen::Vector2d> Project(const Eigen::Vector3d& point_c,
                                         Eigen::Matrix<double, 2, 3>* by_point = nullptr,
                                         Eigen::Matrix<double, 2, Eigen::Dynamic>* by_parameters = nullptr) const;

  // The direction, of unit length, that a pixel sees: Newton's method to 1e-10 of the unit image plane. Nothing if the
  // pixel has no direction under this model or the iteration does not converge to one.
  std::optional<Eigen::Vector3d> Unproject(const Eigen::Vector2d& pixel) const;

  // Whether bilinear interpolation at this pixel stays inside the raw image.
  bool Contains(const Eigen::Vector2d& pixel, double margin_px = 0.0) const {
    return Intrinsics().Contains(pixel, margin_px);
  }

  // "radial_tangential 752x480 fx 458.654 ...", for messages and `cairn info`.
  std::string Describe() const;
};

}  // namespace cairn
