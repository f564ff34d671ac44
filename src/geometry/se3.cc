#include "geometry/se3.h"

#include <cmath>

namespace cairn {
namespace {

constexpr double kSmallAngleRad = 1e-5;

// (1 - cos t) / t^2 and (t - sin t) / t^3 with their limits.
struct SineTerms {
  double b;
  double c;
};

SineTerms ComputeSineTerms(double angle_rad) {
  const double t2 = angle_rad * angle_rad;
  if (angle_rad < kSmallAngleRad) return {0.5 - t2 / 24.0, 1.0 / 6.0 - t2 / 120.0};
  return {(1.0 - std::cos(angle_rad)) / t2, (angle_rad - std::sin(angle_rad)) / (t2 * angle_rad)};
}

// The matrix W of the Sim(3) exponential, translation = W * v: the integral over a in [0, 1] of e^(a lambda) Exp(a w).
// Strasdat 2012, Sec. 2.4: W = C I + A [w]x + B [w]x^2.
Matrix3d SimilarityJacobian(const Vector3d& w, double lambda) {
  const double t = w.norm();
  const double scale = std::exp(lambda);
  const Matrix3d hat = Hat(w);
  double a, b, c;
  if (std::abs(lambda) < kSmallAngleRad) {
    c = 1.0 + lambda / 2.0;
    if (t < kSmallAngleRad) {
      a = 0.5 + lambda / 3.0;
      b = 1.0 / 6.0 + lambda / 8.0;
    } else {
      // First order in lambda: the integrals of a e^(...) terms with e^(a lambda) ~ 1 + a lambda.
      const double t2 = t * t;
      const double s = std::sin(t), k = std::cos(t);
      a = (1.0 - k) / t2 + lambda * (s - t * k) / (t2 * t);
      b = (t - s) / (t2 * t) + lambda * (0.5 - (t * s + k - 1.0) / t2) / t2;
    }
  } else {
    c = (scale - 1.0) / lambda;
    if (t < kSmallAngleRad) {
      const double l2 = lambda * lambda;
      a = ((lambda - 1.0) * scale + 1.0) / l2;
      b = (scale * (0.5 * l2 - lambda + 1.0) - 1.0) / (l2 * lambda);
    } else {
      const double s = scale * std::sin(t), k = scale * std::cos(t);
      const double d = lambda * lambda + t * t;
      a = (s * lambda + (1.0 - k) * t) / (t * d);
      b = (c - ((k - 1.0) * lambda + s * t) / d) / (t * t);
    }
  }
  return c * Matrix3d::Identity() + a * hat + b * hat * hat;
}

}  // namespace

Matrix3d Hat(const Vector3d& v) {
  Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

Quaterniond ExpSO3(const Vector3d& w_rad) {
  const double angle = w_rad.norm();
  const double half = 0.5 * angle;
  const double factor = angle < kSmallAngleRad ? 0.5 - angle * angle / 48.0 : std::sin(half) / angle;
  const Vector3d v = factor * w_rad;
  return Quaterniond(std::cos(half), v.x(), v.y(), v.z());
}

Vector3d LogSO3(const Quaterniond& rotation) {
  const double sign = rotation.w() < 0.0 ? -1.0 : 1.0;
  const Vector3d v = sign * rotation.vec();
  const double w = sign * rotation.w();
  const double n = v.norm();
  if (n < kSmallAngleRad) return (2.0 / w) * (1.0 - n * n / (3.0 * w * w)) * v;
  return (2.0 * std::atan2(n, w) / n) * v;
}

Matrix3d LeftJacobianSO3(const Vector3d& w_rad) {
  const auto [b, c] = ComputeSineTerms(w_rad.norm());
  const Matrix3d hat = Hat(w_rad);
  return Matrix3d::Identity() + b * hat + c * hat * hat;
}

double AngleRad(const Quaterniond& rotation) { return 2.0 * std::atan2(rotation.vec().norm(), std::abs(rotation.w())); }

SE3 SE3::Exp(const Vector6d& tangent) {
  const Vector3d w = tangent.tail<3>();
  return SE3(ExpSO3(w), LeftJacobianSO3(w) * tangent.head<3>());
}

Vector6d SE3::Log() const {
  const Vector3d w = LogSO3(rotation_);
  Vector6d tangent;
  tangent << LeftJacobianSO3(w).inverse() * translation_, w;
  return tangent;
}

Matrix6d SE3::Adjoint() const {
  const Matrix3d r = RotationMatrix();
  Matrix6d adjoint;
  adjoint << r, Hat(translation_) * r, Matrix3d::Zero(), r;
  return adjoint;
}

Matrix34d SE3::Matrix() const {
  Matrix34d m;
  m << RotationMatrix(), translation_;
  return m;
}

SE3 SE3::Inverse() const {
  const Quaterniond inverse = rotation_.conjugate();
  return SE3(inverse, -(inverse * translation_));
}

SE3 SE3::operator*(const SE3& other) const {
  return SE3(rotation_ * other.rotation_, rotation_ * other.translation_ + translation_);
}

Sim3 Sim3::Exp(const Vector7d& tangent) {
  const Vector3d w = tangent.segment<3>(3);
  return Sim3(ExpSO3(w), SimilarityJacobian(w, tangent[6]) * tangent.head<3>(), std::exp(tangent[6]));
}

Vector7d Sim3::Log() const {
  const Vector3d w = LogSO3(rotation_);
  const double lambda = std::log(scale_);
  Vector7d tangent;
  tangent << SimilarityJacobian(w, lambda).inverse() * translation_, w, lambda;
  return tangent;
}

Sim3 Sim3::Inverse() const {
  const Quaterniond inverse = rotation_.conjugate();
  return Sim3(inverse, -(inverse * translation_) / scale_, 1.0 / scale_);
}

Sim3 Sim3::operator*(const Sim3& other) const {
  return Sim3(rotation_ * other.rotation_, scale_ * (rotation_ * other.translation_) + translation_,
              scale_ * other.scale_);
}

SE3 Sim3::TransformPose(const SE3& map_from_camera) const {
  return SE3(rotation_ * map_from_camera.rotation(), *this * map_from_camera.translation());
}

}  // namespace cairn
