#include "optimization/ceres_costs.h"

#include <Eigen/LU>
#include <cmath>

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

bool LensReprojectionCost::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  const Eigen::Map<const Quaterniond> rotation(parameters[0]);
  const Eigen::Map<const Vector3d> translation(parameters[0] + 4);
  const Eigen::Map<const Vector3d> point(parameters[1]);
  const double focal_scale = std::exp(parameters[2][0]), k1 = parameters[2][1], k2 = parameters[2][2];
  const Matrix3d matrix = rotation.toRotationMatrix();
  const Vector3d point_c = matrix * point + translation;
  if (!InFront(point_c)) return false;
  const Vector2d plane = point_c.head<2>() / point_c.z();
  const double r2 = plane.squaredNorm(), radial = 1.0 + r2 * (k1 + r2 * k2);
  const Vector2d focal = weight_ * focal_scale * Vector2d(pinhole_.fx_px, pinhole_.fy_px);
  const Vector2d seen = radial * focal.cwiseProduct(plane);
  Eigen::Map<Vector2d> r(residuals);
  r = seen + weight_ * (Vector2d(pinhole_.cx_px, pinhole_.cy_px) - pixel_);
  if (jacobians == nullptr) return true;
  // By the plane: radial I + x (2 k1 + 4 k2 r^2) x^T; the plane by the point in the camera.
  const Eigen::Matrix2d by_plane =
      focal.asDiagonal() *
      (radial * Eigen::Matrix2d::Identity() + (2.0 * k1 + 4.0 * k2 * r2) * plane * plane.transpose()).eval();
  Eigen::Matrix<double, 2, 3> plane_by_point;
  plane_by_point << 1.0, 0.0, -plane.x(), 0.0, 1.0, -plane.y();
  const Eigen::Matrix<double, 2, 3> by_camera_point = by_plane * plane_by_point / point_c.z();
  if (jacobians[0] != nullptr) {
    Eigen::Map<Row7> j(jacobians[0]);
    j.leftCols<3>() = by_camera_point;
    j.middleCols<3>(3) = -by_camera_point * Hat(point_c);
    j.col(6).setZero();
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Row3> j(jacobians[1]);
    j = by_camera_point * matrix;
  }
  if (jacobians[2] != nullptr) {
    Eigen::Map<Row3> j(jacobians[2]);
    j.col(0) = seen;
    j.col(1) = r2 * focal.cwiseProduct(plane);
    j.col(2) = r2 * j.col(1);
  }
  return true;
}

bool LensPriorCost::Evaluate(double const* const* parameters, double* residuals, double** jacobians) const {
  Eigen::Map<Vector3d> r(residuals);
  r = weights_.cwiseProduct(Eigen::Map<const Vector3d>(parameters[0]));
  if (jacobians == nullptr || jacobians[0] == nullptr) return true;
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> j(jacobians[0]);
  j = weights_.asDiagonal();
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
