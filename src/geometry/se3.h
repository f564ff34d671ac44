// Rigid and similarity transforms. `a_from_b` takes a point in frame b to frame a: point_a = a_from_b * point_b.
//
// Tangent vectors are (translation, rotation[, log scale]) and increments act from the left: x [+] T = Exp(x) T, as in
// the paper (Sec. III). Formulas: Eade, "Lie groups for 2D and 3D transformations" (2013); Strasdat, "Local accuracy
// and global consistency for efficient visual SLAM" (PhD thesis, 2012), for the similarity group.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace cairn {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;
using Matrix34d = Eigen::Matrix<double, 3, 4>;

// [v]x, so that Hat(v) * w = v x w.
Matrix3d Hat(const Vector3d& v);

// Rotation by |w| radians about w, and back (|result| <= pi).
Quaterniond ExpSO3(const Vector3d& w_rad);
Vector3d LogSO3(const Quaterniond& rotation);
// Left Jacobian of SO(3): Exp(w + d) ~ Exp(J(w) d) Exp(w).
Matrix3d LeftJacobianSO3(const Vector3d& w_rad);

// Angle of a rotation, in [0, pi].
double AngleRad(const Quaterniond& rotation);

class SE3 {
 public:
  SE3() : rotation_(Quaterniond::Identity()), translation_(Vector3d::Zero()) {}
  SE3(const Quaterniond& rotation, const Vector3d& translation)
      : rotation_(rotation.normalized()), translation_(translation) {}
  SE3(const Matrix3d& rotation, const Vector3d& translation) : SE3(Quaterniond(rotation), translation) {}

  // The rotation is of unit length already and kept to the bit: for poses read back from a file.
  static SE3 FromUnit(const Quaterniond& rotation, const Vector3d& translation) {
    SE3 pose;
    pose.rotation_ = rotation;
    pose.translation_ = translation;
    return pose;
  }

  static SE3 Exp(const Vector6d& tangent);
  Vector6d Log() const;
  // SE3::Exp(A.Adjoint() * x) * A == A * SE3::Exp(x).
  Matrix6d Adjoint() const;

  const Quaterniond& rotation() const { return rotation_; }
  const Vector3d& translation() const { return translation_; }
  Vector3d& translation() { return translation_; }
  Matrix3d RotationMatrix() const { return rotation_.toRotationMatrix(); }
  Matrix34d Matrix() const;

  SE3 Inverse() const;
  SE3 operator*(const SE3& other) const;
  Vector3d operator*(const Vector3d& point) const { return rotation_ * point + translation_; }

 private:
  Quaterniond rotation_;
  Vector3d translation_;
};

class Sim3 {
 public:
  Sim3() : rotation_(Quaterniond::Identity()), translation_(Vector3d::Zero()), scale_(1.0) {}
  Sim3(const Quaterniond& rotation, const Vector3d& translation, double scale)
      : rotation_(rotation.normalized()), translation_(translation), scale_(scale) {}
  explicit Sim3(const SE3& rigid) : Sim3(rigid.rotation(), rigid.translation(), 1.0) {}

  // As SE3::FromUnit.
  static Sim3 FromUnit(const Quaterniond& rotation, const Vector3d& translation, double scale) {
    Sim3 similarity;
    similarity.rotation_ = rotation;
    similarity.translation_ = translation;
    similarity.scale_ = scale;
    return similarity;
  }

  static Sim3 Exp(const Vector7d& tangent);
  Vector7d Log() const;

  const Quaterniond& rotation() const { return rotation_; }
  const Vector3d& translation() const { return translation_; }
  double scale() const { return scale_; }
  Matrix3d RotationMatrix() const { return rotation_.toRotationMatrix(); }

  Sim3 Inverse() const;
  Sim3 operator*(const Sim3& other) const;
  Vector3d operator*(const Vector3d& point) const { return scale_ * (rotation_ * point) + translation_; }

  // The pose of a camera seen from the far side of the similarity: for world_from_map * map_from_camera this is
  // world_from_camera, a rigid transform with the camera's centre moved and its axes turned, not scaled.
  SE3 TransformPose(const SE3& map_from_camera) const;

 private:
  Quaterniond rotation_;
  Vector3d translation_;
  double scale_;
};

// The camera that sees the map through a similarity `camera_from_map`: what it sees does not depend on the scale.
inline SE3 RigidPart(const Sim3& camera_from_map) {
  return {camera_from_map.rotation(), camera_from_map.translation() / camera_from_map.scale()};
}

// The same motion where lengths are `scale` times as large.
inline SE3 Scaled(const SE3& motion, double scale) { return {motion.rotation(), scale * motion.translation()}; }

}  // namespace cairn
