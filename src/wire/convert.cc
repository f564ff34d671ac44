#include "wire/convert.h"

#include <cmath>

#include "wire/reading.h"

namespace cairn::wire {

void ToProto(const SE3& pose, v1::Pose* out) {
  Write(pose.translation(), out->mutable_translation());
  Write(pose.rotation(), out->mutable_rotation());
}

void ToProto(const Sim3& similarity, v1::Similarity* out) {
  Write(similarity.translation(), out->mutable_translation());
  Write(similarity.rotation(), out->mutable_rotation());
  out->set_scale(similarity.scale());
}

absl::StatusOr<SE3> FromProto(const v1::Pose& message) {
  CAIRN_ASSIGN_OR_RETURN(const Vector3d translation, Read(message.translation()));
  CAIRN_ASSIGN_OR_RETURN(const Quaterniond rotation, Read(message.rotation()));
  return SE3::FromUnit(rotation, translation);
}

absl::StatusOr<Sim3> FromProto(const v1::Similarity& message) {
  CAIRN_ASSIGN_OR_RETURN(const Vector3d translation, Read(message.translation()));
  CAIRN_ASSIGN_OR_RETURN(const Quaterniond rotation, Read(message.rotation()));
  if (!(message.scale() > 0.0 && std::isfinite(message.scale()))) {
    return absl::InvalidArgumentError("scale: must be positive");
  }
  return Sim3::FromUnit(rotation, translation, message.scale());
}

void ToProto(const Camera& camera, v1::Camera* out) {
  out->set_model(Write(camera.model));
  out->set_width_px(camera.width_px);
  out->set_height_px(camera.height_px);
  out->set_fx_px(camera.fx_px);
  out->set_fy_px(camera.fy_px);
  out->set_cx_px(camera.cx_px);
  out->set_cy_px(camera.cy_px);
  out->mutable_distortion()->Add(camera.distortion.begin(), camera.distortion.end());
}

absl::StatusOr<Camera> FromProto(const v1::Camera& message) {
  Camera camera;
  CAIRN_ASSIGN_OR_RETURN(camera.model, Read(message.model()));
  camera.width_px = message.width_px();
  camera.height_px = message.height_px();
  camera.fx_px = message.fx_px();
  camera.fy_px = message.fy_px();
  camera.cx_px = message.cx_px();
  camera.cy_px = message.cy_px();
  camera.distortion.assign(message.distortion().begin(), message.distortion().end());
  CAIRN_RETURN_IF_ERROR(Annotate(camera.Validate(), "camera"));
  return camera;
}

void ToProto(const cv::Mat& gray, v1::Image* out) {
  std::string* bytes = out->mutable_gray();
  const std::size_t row = static_cast<std::size_t>(gray.cols);
  bytes->reserve(row * static_cast<std::size_t>(gray.rows));
  for (int y = 0; y < gray.rows; ++y) bytes->append(reinterpret_cast<const char*>(gray.ptr<std::uint8_t>(y)), row);
}

}  // namespace cairn::wire
