#include "optimization/ceres_costs.h"

#include <Eigen/LU>

#include "optimization/reprojection.h"

namespace cairn::optimization::internal {
namespace {

using Row7 = Eigen::Matrix<double, 2, 7, Eigen::RowMajor>;
using Row3 = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;
using Row67 = Eigen::Matrix<double, 6, 7, Eigen::RowMajor>;

}  // namespace

void PoseToBlock(const SE3& pose, double* block) {
  Eigen::Map<Eigen::Matrix<double, 7, 1>> coordinates(block);
  coordinates << pose.rotation().coeffs(), pose.translation();
}

SE3 PoseFromBlock(const double* block) {
  return {Quaterniond(Eigen::Map<const Eigen::Vector4d>(block)), Eigen::Map<const Vector3d>(block + 4)};
}

bool LeftIncrementManifold::Plus(const double* x, const double* delta, double* x_plus_delta) const {
  PoseToBlock(SE3::Exp(Eigen::Map<const Vector6d>(delta)) * PoseFromBlock(x), x_plus_delta);
  return true;
}

bool LeftIncrementManifold::PlusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> j(jacobian);
  j.setZero();
  j.topRows<6>().setIdentity();
  return true;
}

bool LeftIncrementManifold::Minus(const double* y, const double* x, double* y_minus_x) const {
  Eigen::Map<Vector6d> difference(y_minus_x);
  difference = (PoseFromBlock(y) * PoseFromBlock(x).Inverse()).Log();
  return true;
}

bool LeftIncrementManifold::MinusJacobian(const double*, double* jacobian) const {
  Eigen::Map<Row67> j(jacobian);
  j.setZero();
  j.leftCols<6>().setIdentity();
  return true;
}

bool ReprojectionCost::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const Eigen::Map<const Quaterniond> rotation(parameters[0]);
  const Eigen::Map<const Vector3d> translation(parameters[0] + 4);
  const Eigen::Map<const Vector3d> point(parameters[1]);
  const Matrix3d matrix = rotation.toRotationMatrix();
  const Vector3d point_c = matrix * point + translation;
  if (!InFront(point_c)) return false;
  Eigen::Map<Vector2d> r(residuals);
  r = weight_ * ReprojectionResidual(pinhole_, point_c, pixel_);
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) {
    Eigen::Map<Row7> j(jacobians[0]);
    j.leftCols<6>() = weight_ * ReprojectionByPose(pinhole_, point_c);
    j.col(6).setZero();
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Row3> j(jacobians[1]);
    j = weight_ * ReprojectionByPoint(pinhole_, matrix, point_c);
  }
  return true;
}

PosePriorCost::PosePriorCost(const SE3& camera_from_map, double position_sigma, double rotation_sigma_rad)
    : map_from_camera_rotation_(camera_from_map.rotation().conjugate()),
      center_(camera_from_map.Inverse().translation()),
      position_weight_(1.0 / position_sigma),
      rotation_weight_(1.0 / rotation_sigma_rad) {}

bool PosePriorCost::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const SE3 pose = PoseFromBlock(parameters[0]);
  const Vector3d rotation_error = LogSO3(pose.rotation() * map_from_camera_rotation_);
  Eigen::Map<Vector6d> r(residuals);
  r.head<3>() = position_weight_ * (pose.Inverse().translation() - center_);
  r.tail<3>() = rotation_weight_ * rotation_error;
  if (jacobians == nullptr || jacobians[0] == nullptr) return true;
  // The centre -R^T t moves by -R^T x_t; rotations about it leave it. Log(Exp(x) E) ~ Log(E) + J_l(Log(E))^-1 x.
  Eigen::Map<Row67> j(jacobians[0]);
  j.setZero();
  j.topLeftCorner<3, 3>() = -position_weight_ * pose.RotationMatrix().transpose();
  j.block<3, 3>(3, 3) = rotation_weight_ * LeftJacobianSO3(rotation_error).inverse();
  return true;
}

Vector3d RelativeRotationCost::Residual(const Quaterniond& a, const Quaterniond& b, Matrix3d* by_a,
                                        Matrix3d* by_b) const {
  const Quaterniond b_from_a = b * a.conjugate();
  const Vector3d error = LogSO3(b_from_a * a_from_b_);
  // (Exp(y) R_b) (Exp(x) R_a)^-1 = Exp(y) R_ba Exp(-x) = Exp(y) Exp(-R_ba x) R_ba.
  if (by_b != nullptr) *by_b = weight_ * LeftJacobianSO3(error).inverse();
  if (by_b != nullptr && by_a != nullptr) *by_a = -*by_b * b_from_a.toRotationMatrix();
  return weight_ * error;
}

bool RelativeRotationCost::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const Quaterniond a = PoseFromBlock(parameters[0]).rotation(), b = PoseFromBlock(parameters[1]).rotation();
  Matrix3d by[2];
  Eigen::Map<Vector3d> r(residuals);
  r = Residual(a, b, &by[0], &by[1]);
  for (int i = 0; jacobians != nullptr && i < 2; ++i) {
    if (jacobians[i] == nullptr) continue;
    Eigen::Map<Eigen::Matrix<double, 3, 7, Eigen::RowMajor>> j(jacobians[i]);
    j.setZero();
    j.block<3, 3>(0, 3) = by[i];
  }
  return true;
}

}  // namespace cairn::optimization::internal
