#include "tracking/map_error.h"

#include <algorithm>
#include <cmath>

namespace cairn::tracking {
namespace {

constexpr double kManyInliers = 150.0;
constexpr double kMisfitPower = 3.0;

}  // namespace

absl::Status MapErrorOptions::Validate() const {
  if (depth_share >= 0.0 && rotation_rad >= 0.0) return absl::OkStatus();
  return absl::InvalidArgumentError("map error: depth_share and rotation_rad must not be negative");
}

MapError MapErrorOf(const MapFit& fit, const MapErrorOptions& options) {
  const double few = std::sqrt(std::max(1.0, kManyInliers / std::max(fit.inliers, 1)));
  const double misfit = few * std::pow(fit.residual_rms, kMisfitPower);
  return {misfit * options.depth_share * fit.median_depth, misfit * options.rotation_rad};
}

Matrix6d CovarianceAtCamera(const SE3& map_from_camera, double translation_sigma, double rotation_sigma_rad) {
  Vector6d variance;
  variance << Vector3d::Constant(translation_sigma * translation_sigma),
      Vector3d::Constant(rotation_sigma_rad * rotation_sigma_rad);
  // T Exp(x) = Exp(Ad(T) x) T.
  const Matrix6d adjoint = map_from_camera.Adjoint();
  return adjoint * variance.asDiagonal() * adjoint.transpose();
}

}  // namespace cairn::tracking
