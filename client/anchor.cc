#include "client/anchor.h"

#include <algorithm>
#include <cmath>

namespace cairn::client {
namespace {

constexpr double kManyInliers = 150.0;
constexpr double kMisfitPower = 3.0;

}  // namespace

absl::Status DriftOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("tracker: ", what)); };
  if (!(way_share >= 0.0 && turn_share >= 0.0)) return bad("way_share and turn_share must not be negative");
  if (!(depth_share > 0.0 && rotation_rad > 0.0)) return bad("depth_share and rotation_rad must be positive");
  if (!(blind_factor >= 1.0)) return bad("blind_factor must be at least 1");
  if (!(map_depth_share >= 0.0 && map_rotation_rad >= 0.0)) {
    return bad("map_depth_share and map_rotation_rad must not be negative");
  }
  return absl::OkStatus();
}

void Odometer::Add(const SE3& motion, double factor) {
  way += factor * motion.translation().norm();
  turn_rad += factor * AngleRad(motion.rotation());
}

MotionSigma SigmaSince(const Anchor& anchor, const Odometer& now, const DriftOptions& options) {
  const double way = now.way - anchor.odometer.way, turn_rad = now.turn_rad - anchor.odometer.turn_rad;
  return {std::hypot(options.way_share * way, options.depth_share * anchor.place.median_depth),
          std::hypot(options.turn_share * turn_rad, options.rotation_rad)};
}

Matrix6d CovarianceOf(const Anchor& anchor, const SE3& map_from_camera, const MotionSigma& motion,
                      const DriftOptions& options) {
  // At its edge a map knows few points, and those from few sides.
  const double few = std::sqrt(std::max(1.0, kManyInliers / std::max(anchor.inliers, 1)));
  const double misfit = few * std::pow(anchor.residual_rms, kMisfitPower);
  const double map_sigma = misfit * options.map_depth_share * anchor.place.median_depth;
  const double map_rotation_rad = misfit * options.map_rotation_rad;
  Vector6d variance;
  variance << Vector3d::Constant(motion.translation * motion.translation + map_sigma * map_sigma),
      Vector3d::Constant(motion.rotation_rad * motion.rotation_rad + map_rotation_rad * map_rotation_rad);
  // T Exp(x) = Exp(Ad(T) x) T; a left increment of the anchor's pose is one of every pose that hangs on it.
  const Matrix6d adjoint = map_from_camera.Adjoint();
  return anchor.covariance + adjoint * variance.asDiagonal() * adjoint.transpose();
}

}  // namespace cairn::client
