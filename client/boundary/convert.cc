#include "client/boundary/convert.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cairn::client {
namespace {

v0::CameraModel ModelToPublic(CameraModel model) {
  switch (model) {
    case CameraModel::kPinhole:
      return v0::CameraModel::kPinhole;
    case CameraModel::kRadialTangential:
      return v0::CameraModel::kRadialTangential;
    case CameraModel::kKannalaBrandt:
      return v0::CameraModel::kKannalaBrandt;
    case CameraModel::kFov:
      return v0::CameraModel::kFov;
  }
  return v0::CameraModel::kPinhole;
}

absl::StatusOr<CameraModel> ModelToInternal(v0::CameraModel model) {
  switch (model) {
    case v0::CameraModel::kPinhole:
      return CameraModel::kPinhole;
    case v0::CameraModel::kRadialTangential:
      return CameraModel::kRadialTangential;
    case v0::CameraModel::kKannalaBrandt:
      return CameraModel::kKannalaBrandt;
    case v0::CameraModel::kFov:
      return CameraModel::kFov;
  }
  return absl::InvalidArgumentError(absl::StrCat("camera: there is no model ", static_cast<int>(model)));
}

// A RivalPose, or the answer, which has the same members.
template <class Public>
void PoseToPublic(const api::LocatedPose& pose, Public* out) {
  out->map_from_camera = ToPublic(pose.map_from_camera);
  out->component = pose.component.value();
  out->world_from_camera = ToPublic(pose.world_from_camera);
  out->world_per_map = pose.world_per_map;
  out->world_is_metric = pose.world_is_metric;
  out->covariance = ToPublic(pose.covariance);
  out->reference_keyframe = pose.reference_keyframe.value();
  out->focal_factor = pose.focal_factor;
}

}  // namespace

absl::Status CheckCall(const v0::CallOptions& call, absl::string_view what) {
  if (call.cancellation != nullptr && call.cancellation->cancelled()) {
    return absl::CancelledError(absl::StrCat(what, ": cancelled by the caller"));
  }
  if (call.deadline != std::chrono::steady_clock::time_point::max() &&
      std::chrono::steady_clock::now() >= call.deadline) {
    return absl::DeadlineExceededError(absl::StrCat(what, ": not done by the caller's deadline"));
  }
  return absl::OkStatus();
}

absl::StatusOr<Camera> ToInternal(const v0::Camera& camera) {
  Camera result;
  CAIRN_ASSIGN_OR_RETURN(result.model, ModelToInternal(camera.model));
  result.width_px = camera.width_px;
  result.height_px = camera.height_px;
  result.fx_px = camera.fx_px;
  result.fy_px = camera.fy_px;
  result.cx_px = camera.cx_px;
  result.cy_px = camera.cy_px;
  result.distortion = camera.distortion;
  return result;
}

absl::StatusOr<api::PosePrior> ToInternal(const v0::PosePrior& prior) {
  api::PosePrior result;
  const auto& q = prior.map_from_camera.rotation_xyzw;
  const Quaterniond rotation(q[3], q[0], q[1], q[2]);
  constexpr double kUnit = 1e-3;
  if (!(std::abs(rotation.norm() - 1.0) < kUnit)) {
    return absl::InvalidArgumentError("prior: the quaternion is not of unit length");
  }
  const auto& t = prior.map_from_camera.translation;
  result.map_from_camera = SE3(rotation.normalized(), Vector3d(t[0], t[1], t[2]));
  result.component = ComponentId(prior.component);
  result.position_sigma = prior.position_sigma;
  result.rotation_sigma_rad = prior.rotation_sigma_rad;
  return result;
}

v0::Camera ToPublic(const Camera& camera) {
  v0::Camera result;
  result.model = ModelToPublic(camera.model);
  result.width_px = camera.width_px;
  result.height_px = camera.height_px;
  result.fx_px = camera.fx_px;
  result.fy_px = camera.fy_px;
  result.cx_px = camera.cx_px;
  result.cy_px = camera.cy_px;
  result.distortion = camera.distortion;
  return result;
}

ServerAccess ToInternal(const v0::ServerOptions& server) {
  return {server.token, {server.tls, server.ca_file, server.certificate_file, server.key_file}, server.token_in_clear};
}

absl::StatusOr<cv::Mat> GrayImage(const v0::ImageView& view) {
  CAIRN_RETURN_IF_ERROR(view.Validate());
  const bool gray = view.format == v0::PixelFormat::kGray8;
  const std::size_t stride = view.stride_bytes == 0 ? static_cast<std::size_t>(cv::Mat::AUTO_STEP)
                                                    : static_cast<std::size_t>(view.stride_bytes);
  // OpenCV has no header for pixels that are only read; nobody writes to an input image.
  const cv::Mat pixels(view.height_px, view.width_px, gray ? CV_8UC1 : CV_8UC3, const_cast<std::uint8_t*>(view.data),
                       stride);
  if (gray) return pixels;
  cv::Mat result;
  cv::cvtColor(pixels, result, view.format == v0::PixelFormat::kRgb8 ? cv::COLOR_RGB2GRAY : cv::COLOR_BGR2GRAY);
  return result;
}

v0::Pose ToPublic(const SE3& a_from_b) {
  v0::Pose result;
  for (int i = 0; i < 3; ++i) result.translation[static_cast<std::size_t>(i)] = a_from_b.translation()[i];
  const Quaterniond& q = a_from_b.rotation();
  result.rotation_xyzw = {q.x(), q.y(), q.z(), q.w()};
  return result;
}

v0::PoseCovariance ToPublic(const Matrix6d& covariance) {
  v0::PoseCovariance result;
  for (int i = 0; i < 36; ++i) result[static_cast<std::size_t>(i)] = covariance(i / 6, i % 6);
  return result;
}

v0::LocalizeAnswer ToPublic(const api::LocalizeAnswer& answer) {
  v0::LocalizeAnswer result;
  result.localized = answer.localized;
  result.stage = static_cast<v0::LocalizeStage>(answer.stage);
  result.reason = answer.reason;
  const api::LocalizeCounts& counts = answer.counts;
  result.counts = {counts.features,    counts.candidates,     counts.word_matches,
                   counts.pnp_inliers, counts.guided_matches, counts.inliers};
  PoseToPublic(answer, &result);
  result.components = answer.components;
  for (const api::LocatedPose& rival : answer.rivals) {
    PoseToPublic(rival, &result.rivals.emplace_back());
    result.rivals.back().inliers = rival.inliers;
  }
  result.map_id = answer.map_id;
  result.revision = answer.revision;
  result.lens = static_cast<v0::LensUse>(answer.lens);
  result.extract_ms = answer.extract_ms;
  result.locate_ms = answer.locate_ms;
  return result;
}

v0::TrackAnswer ToPublic(const api::TrackAnswer& answer) {
  v0::TrackAnswer result;
  result.time_ns = answer.time_ns;
  result.state = static_cast<v0::TrackState>(answer.state);
  result.reason = answer.reason;
  result.map_from_camera = ToPublic(answer.map_from_camera);
  result.component = answer.component.value();
  result.world_from_camera = ToPublic(answer.world_from_camera);
  result.world_per_map = answer.world_per_map;
  result.world_is_metric = answer.world_is_metric;
  result.covariance = ToPublic(answer.covariance);
  result.map_id = answer.map_id;
  result.revision = answer.revision;
  result.matched_ns = answer.matched_ns;
  result.inliers = answer.inliers;
  result.note = answer.note;
  result.track_ms = answer.track_ms;
  result.connected = answer.connected;
  result.map_age_s = answer.map_age_s;
  result.focal_factor = answer.focal_factor;
  return result;
}

v0::MapInfo InfoOf(const map::Snapshot& map) {
  v0::MapInfo info;
  info.id = map.info().id;
  info.name = map.info().name;
  info.revision = map.revision();
  info.keyframes = static_cast<std::int64_t>(map.keyframes().size());
  info.points = static_cast<std::int64_t>(map.points().size());
  for (const auto& [id, camera] : map.cameras()) {
    info.cameras.push_back({id.value(), camera.name, ToPublic(camera.model)});
  }
  for (const ComponentId id : map.LiveComponents()) {
    v0::MapComponent component;
    component.id = id.value();
    component.keyframes = map.NumKeyframes(id);
    if (const auto& world_from_component = map.WorldFrom(id)) {
      component.aligned = true;
      component.world_from_component = {
          ToPublic(SE3::FromUnit(world_from_component->rotation(), world_from_component->translation())),
          world_from_component->scale()};
    }
    info.components.push_back(component);
  }
  return info;
}

}  // namespace cairn::client
