#include "geometry/pose_alignment_model.h"

#include <Eigen/LU>
#include <cmath>

namespace cairn {

PoseAlignmentState PoseAlignmentState::Plus(const Increment& x) const {
  PoseAlignmentState moved = *this;
  moved.center_a += x.segment<3>(kCenter);
  moved.rotation = (ExpSO3(x.segment<3>(kRotation)) * rotation).normalized();
  moved.scale *= std::exp(x[kLogScale]);
  moved.camera_from_body = (ExpSO3(x.segment<3>(kMount)) * camera_from_body).normalized();
  moved.camera_in_body += x.segment<3>(kLever);
  return moved;
}

PoseAlignmentResidual EvaluatePoseAlignment(const PoseAlignmentState& state, const SE3& pose_a, const SE3& pose_b) {
  PoseAlignmentResidual residual;
  const Vector3d arm = state.scale * (state.rotation * (pose_b.translation() - state.center_b));
  residual.position = pose_a * state.camera_in_body - (state.center_a + arm);
  residual.rotation_rad =
      LogSO3(state.rotation * pose_b.rotation() * state.camera_from_body * pose_a.rotation().conjugate());
  return residual;
}

PoseAlignmentResidual LinearizePoseAlignment(const PoseAlignmentState& state, const SE3& pose_a, const SE3& pose_b) {
  using State = PoseAlignmentState;
  PoseAlignmentResidual residual = EvaluatePoseAlignment(state, pose_a, pose_b);
  const Vector3d arm = state.scale * (state.rotation * (pose_b.translation() - state.center_b));
  residual.position_jacobian.middleCols<3>(State::kCenter) = -Matrix3d::Identity();
  residual.position_jacobian.middleCols<3>(State::kRotation) = Hat(arm);
  residual.position_jacobian.col(State::kLogScale) = -arm;
  residual.position_jacobian.middleCols<3>(State::kLever) = pose_a.RotationMatrix();
  // Log(Exp(d) Exp(e)) ~ e + J(e)^-1 d; a turn of the mount passes through R R_b.
  const Matrix3d log_from_turn = LeftJacobianSO3(residual.rotation_rad).inverse();
  residual.rotation_jacobian.middleCols<3>(State::kRotation) = log_from_turn;
  residual.rotation_jacobian.middleCols<3>(State::kMount) =
      log_from_turn * (state.rotation * pose_b.rotation()).toRotationMatrix();
  return residual;
}

}  // namespace cairn
