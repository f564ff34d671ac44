#include "wire/reading.h"

#include <cmath>

namespace cairn::wire {

void Write(const Vector3d& vector, v1::Vector3* out) {
  out->set_x(vector.x());
  out->set_y(vector.y());
  out->set_z(vector.z());
}

void Write(const Quaterniond& rotation, v1::Quaternion* out) {
  out->set_x(rotation.x());
  out->set_y(rotation.y());
  out->set_z(rotation.z());
  out->set_w(rotation.w());
}

v1::Camera::Model Write(CameraModel model) {
  switch (model) {
    case CameraModel::kPinhole:
      return v1::Camera::MODEL_PINHOLE;
    case CameraModel::kRadialTangential:
      return v1::Camera::MODEL_RADIAL_TANGENTIAL;
    case CameraModel::kKannalaBrandt:
      return v1::Camera::MODEL_KANNALA_BRANDT;
    case CameraModel::kFov:
      return v1::Camera::MODEL_FOV;
  }
  return v1::Camera::MODEL_UNSPECIFIED;
}

absl::StatusOr<Vector3d> Read(const v1::Vector3& message) {
  const Vector3d vector(message.x(), message.y(), message.z());
  if (!vector.allFinite()) return absl::InvalidArgumentError("translation: numbers must be finite");
  return vector;
}

absl::StatusOr<Quaterniond> Read(const v1::Quaternion& message) {
  const Quaterniond rotation(message.w(), message.x(), message.y(), message.z());
  if (!(std::abs(rotation.norm() - 1.0) < 1e-6)) {
    return absl::InvalidArgumentError("rotation: a quaternion x y z w of unit length is needed");
  }
  return rotation;
}

absl::StatusOr<CameraModel> Read(v1::Camera::Model model) {
  switch (model) {
    case v1::Camera::MODEL_PINHOLE:
      return CameraModel::kPinhole;
    case v1::Camera::MODEL_RADIAL_TANGENTIAL:
      return CameraModel::kRadialTangential;
    case v1::Camera::MODEL_KANNALA_BRANDT:
      return CameraModel::kKannalaBrandt;
    case v1::Camera::MODEL_FOV:
      return CameraModel::kFov;
    case v1::Camera::MODEL_UNSPECIFIED:
      return absl::InvalidArgumentError("camera: it is missing, or does not say its model");
    default:
      return absl::InvalidArgumentError(absl::StrCat("camera: there is no model ", static_cast<int>(model)));
  }
}

void Write(const Matrix6d& matrix, google::protobuf::RepeatedField<double>* out) {
  out->Clear();
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) out->Add(matrix(row, column));
  }
}

absl::StatusOr<Matrix6d> ReadMatrix(const google::protobuf::RepeatedField<double>& message) {
  Matrix6d matrix = Matrix6d::Zero();
  if (message.empty()) return matrix;
  if (message.size() != 36) return absl::InvalidArgumentError("covariance: 6x6 numbers are needed");
  for (int row = 0; row < 6; ++row) {
    for (int column = 0; column < 6; ++column) matrix(row, column) = message[6 * row + column];
  }
  if (!matrix.allFinite()) return absl::InvalidArgumentError("covariance: numbers must be finite");
  return matrix;
}

}  // namespace cairn::wire
