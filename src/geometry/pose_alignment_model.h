// The measurement model of geometry/pose_alignment.h: what a pair of poses says about the similarity between two
// frames, with its derivatives.
//
// Frame a holds the reference, b the map; the camera's centre is p, its axes R. With the centroid b0 of the positions
// in b, so that rotation and scale do not move the centre of what is aligned,
//   position:  e_p = p_a + R_a l - (center_a + s R (p_b - b0))
//   rotation:  e_r = Log(R R_b C R_a^T)
// C = camera_from_body and l, the camera's centre on the body, are the identity and 0 where a is the camera itself.
// Increments act from the left: R <- Exp(x) R, s <- exp(x) s, C <- Exp(x) C, and are ordered center, rotation, log
// scale, mount, lever arm.
#pragma once

#include "geometry/se3.h"

namespace cairn {

struct PoseAlignmentState {
  static constexpr int kCenter = 0, kRotation = 3, kLogScale = 6, kMount = 7, kLever = 10, kSize = 13;
  using Increment = Eigen::Matrix<double, kSize, 1>;

  Vector3d center_b = Vector3d::Zero();  // fixed
  Vector3d center_a = Vector3d::Zero();
  Quaterniond rotation = Quaterniond::Identity();  // of a_from_b
  double scale = 1.0;
  Quaterniond camera_from_body = Quaterniond::Identity();
  Vector3d camera_in_body = Vector3d::Zero();  // in units of a

  Sim3 AFromB() const { return Sim3(rotation, center_a - scale * (rotation * center_b), scale); }
  PoseAlignmentState Plus(const Increment& x) const;
};

using PoseAlignmentJacobian = Eigen::Matrix<double, 3, PoseAlignmentState::kSize>;

struct PoseAlignmentResidual {
  Vector3d position = Vector3d::Zero();
  Vector3d rotation_rad = Vector3d::Zero();
  PoseAlignmentJacobian position_jacobian = PoseAlignmentJacobian::Zero();
  PoseAlignmentJacobian rotation_jacobian = PoseAlignmentJacobian::Zero();
};

// Without Jacobians, and with.
PoseAlignmentResidual EvaluatePoseAlignment(const PoseAlignmentState& state, const SE3& pose_a, const SE3& pose_b);
PoseAlignmentResidual LinearizePoseAlignment(const PoseAlignmentState& state, const SE3& pose_a, const SE3& pose_b);

}  // namespace cairn
