// Cost functions and the pose manifold of the Ceres problems here. Private to optimization.
//
// A pose block holds (qx qy qz qw tx ty tz) of camera_from_map. Steps are left increments x = (translation, rotation).
// Derivatives by the step are written into the first six columns of the block's 2x7 or 6x7 Jacobian and the manifold's
// Jacobian is [I; 0], so that no derivative by quaternion coordinates ever exists.
#pragma once

#include <ceres/cost_function.h>
#include <ceres/manifold.h>
#include <ceres/sized_cost_function.h>

#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::optimization::internal {

void PoseToBlock(const SE3& pose, double* block);
SE3 PoseFromBlock(const double* block);

class LeftIncrementManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return 7; }
  int TangentSize() const override { return 6; }
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override;
  bool PlusJacobian(const double* x, double* jacobian) const override;
  bool Minus(const double* y, const double* x, double* y_minus_x) const override;
  bool MinusJacobian(const double* x, double* jacobian) const override;
};

// (project(camera_from_map * point) - pixel) / sigma. Blocks: pose, point. Fails for a point behind the camera.
class ReprojectionCost final : public ceres::SizedCostFunction<2, 7, 3> {
 public:
  ReprojectionCost(const Pinhole& pinhole, const Vector2d& pixel, double sigma_px)
      : pinhole_(pinhole), pixel_(pixel), weight_(1.0 / sigma_px) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  const Pinhole& pinhole_;
  Vector2d pixel_;
  double weight_;
};

// The same for a camera whose lens is unknown, too (geometry/lens_correction.h). Blocks: pose, point, lens: log
// focal_scale, k1, k2.
class LensReprojectionCost final : public ceres::SizedCostFunction<2, 7, 3, 3> {
 public:
  LensReprojectionCost(const Pinhole& pinhole, const Vector2d& pixel, double sigma_px)
      : pinhole_(pinhole), pixel_(pixel), weight_(1.0 / sigma_px) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  const Pinhole& pinhole_;
  Vector2d pixel_;
  double weight_;
};

// (log focal_scale, k1, k2) against none, over their standard deviations. Block: lens.
class LensPriorCost final : public ceres::SizedCostFunction<3, 3> {
 public:
  explicit LensPriorCost(const Vector3d& sigmas) : weights_(sigmas.cwiseInverse()) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  Vector3d weights_;
};

// Difference of the camera centres over the position sigma, then of the rotations, Log(R R0^-1), over the rotation
// sigma.
class PosePriorCost final : public ceres::SizedCostFunction<6, 7> {
 public:
  PosePriorCost(const SE3& camera_from_map, double position_sigma, double rotation_sigma_rad);
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

 private:
  Quaterniond map_from_camera_rotation_;
  Vector3d center_;
  double position_weight_;
  double rotation_weight_;
};

// Log(R_b R_a^-1 b_from_a^-1) over sigma. Blocks: pose a, pose b.
class RelativeRotationCost final : public ceres::SizedCostFunction<3, 7, 7> {
 public:
  RelativeRotationCost(const Quaterniond& b_from_a, double sigma_rad)
      : a_from_b_(b_from_a.normalized().conjugate()), weight_(1.0 / sigma_rad) {}
  bool Evaluate(double const* const* parameters, double* residuals, double** jacobians) const override;

  // The residual of two poses, and its derivatives by the rotations of their left increments.
  Vector3d Residual(const Quaterniond& a, const Quaterniond& b, Matrix3d* by_a, Matrix3d* by_b) const;

 private:
  Quaterniond a_from_b_;
  double weight_;
};

}  // namespace cairn::optimization::internal
