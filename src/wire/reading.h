// The small parts of messages, for those who convert the large ones.
#pragma once

#include <cairn/v1/types.pb.h>

#include "base/status.h"
#include "geometry/camera.h"
#include "geometry/se3.h"

namespace cairn::wire {

void Write(const Vector3d& vector, v1::Vector3* out);
void Write(const Quaterniond& rotation, v1::Quaternion* out);
v1::Camera::Model Write(CameraModel model);

// InvalidArgument for numbers that are not finite, quaternions that are not of unit length within 1e-6, and models that
// there are not.
absl::StatusOr<Vector3d> Read(const v1::Vector3& message);
absl::StatusOr<Quaterniond> Read(const v1::Quaternion& message);
absl::StatusOr<CameraModel> Read(v1::Camera::Model model);

// 6x6 by rows. Empty is zero; InvalidArgument for another number of them, or one that is not finite.
void Write(const Matrix6d& matrix, google::protobuf::RepeatedField<double>* out);
absl::StatusOr<Matrix6d> ReadMatrix(const google::protobuf::RepeatedField<double>& message);

}  // namespace cairn::wire
