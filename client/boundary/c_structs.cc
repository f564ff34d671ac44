#include "client/boundary/c_structs.h"

#include <chrono>
#include <cstddef>

#include "client/boundary/c_handles.h"

namespace cairn::client {
namespace {

// Until a struct grows; of one that has, what was added begins where it ended.
static_assert(sizeof(void*) != 8 ||
              (sizeof(cairn_error) == kFirstSize<cairn_error> &&
               sizeof(cairn_call_options) == kFirstSize<cairn_call_options> &&
               offsetof(cairn_map_options, token) == kFirstSize<cairn_map_options> &&
               sizeof(cairn_map_info) == kFirstSize<cairn_map_info> &&
               sizeof(cairn_camera) == kFirstSize<cairn_camera> && sizeof(cairn_image) == kFirstSize<cairn_image> &&
               sizeof(cairn_component) == kFirstSize<cairn_component> &&
               sizeof(cairn_localize_query) == kFirstSize<cairn_localize_query> &&
               sizeof(cairn_prior) == kFirstSize<cairn_prior> &&
               sizeof(cairn_localize_answer) == kFirstSize<cairn_localize_answer> &&
               sizeof(cairn_tracker_options) == kFirstSize<cairn_tracker_options> &&
               offsetof(cairn_track_answer, connected) == kFirstSize<cairn_track_answer>));

absl::Status CheckReserved(std::int32_t reserved, absl::string_view name) {
  if (reserved == 0) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(name, ": reserved must be 0: begin with {sizeof ...}"));
}

cairn_pose PoseToC(const v0::Pose& pose) {
  cairn_pose result;
  std::copy(pose.translation.begin(), pose.translation.end(), result.translation);
  std::copy(pose.rotation_xyzw.begin(), pose.rotation_xyzw.end(), result.rotation_xyzw);
  return result;
}

// What the answers of localizers and trackers have in common.
template <class Answer, class Struct>
void LocatedToC(const Answer& answer, Struct* result) {
  result->map_from_camera = PoseToC(answer.map_from_camera);
  result->world_from_camera = PoseToC(answer.world_from_camera);
  result->world_per_map = answer.world_per_map;
  std::copy(answer.covariance.begin(), answer.covariance.end(), result->covariance);
  result->position_sigma = v0::PositionSigma(answer.map_from_camera, answer.covariance);
  result->rotation_sigma_rad = v0::RotationSigmaRad(answer.covariance);
  result->world_is_metric = answer.world_is_metric ? 1 : 0;
  result->component = answer.component;
  result->revision = answer.revision;
  WriteString(answer.map_id, result->map_id, sizeof(result->map_id));
  WriteString(answer.reason, result->reason, sizeof(result->reason));
}

}  // namespace

void WriteString(absl::string_view from, char* to, std::size_t size) {
  std::size_t length = std::min(from.size(), size - 1);
  if (length < from.size()) {
    while (length > 0 && (static_cast<unsigned char>(from[length]) & 0xC0) == 0x80) --length;
  }
  std::copy_n(from.data(), length, to);
  std::memset(to + length, 0, size - length);
}

absl::StatusOr<v0::CallOptions> ReadCall(const cairn_call_options* call) {
  v0::CallOptions result;
  if (call == nullptr) return result;
  CAIRN_ASSIGN_OR_RETURN(const cairn_call_options options, ReadStruct(call, "cairn_call_options"));
  if (options.timeout_ns < 0) {
    return absl::InvalidArgumentError("cairn_call_options: timeout_ns must not be negative");
  }
  const auto now = std::chrono::steady_clock::now();
  const auto left = std::chrono::steady_clock::time_point::max() - now;
  if (options.timeout_ns > 0 && std::chrono::nanoseconds(options.timeout_ns) < left) {
    result.deadline = now + std::chrono::nanoseconds(options.timeout_ns);
  }
  if (options.cancellation != nullptr) result.cancellation = &options.cancellation->cancellation;
  return result;
}

absl::StatusOr<v0::MapOptions> ReadMapOptions(const cairn_map_options* options) {
  v0::MapOptions result;
  if (options == nullptr) return result;
  CAIRN_ASSIGN_OR_RETURN(const cairn_map_options known, ReadStruct(options, "cairn_map_options"));
  CAIRN_RETURN_IF_ERROR(CheckReserved(known.reserved, "cairn_map_options"));
  result.num_features = known.num_features;
  const auto text = [](const char* given) { return std::string(given == nullptr ? "" : given); };
  result.server = {text(known.token),    text(known.ca_file), text(known.certificate_file),
                   text(known.key_file), known.tls != 0,      known.token_in_clear != 0};
  return result;
}

absl::StatusOr<v0::TrackerOptions> ReadTrackerOptions(const cairn_tracker_options* options) {
  v0::TrackerOptions result;
  if (options == nullptr) return result;
  CAIRN_ASSIGN_OR_RETURN(const cairn_tracker_options known, ReadStruct(options, "cairn_tracker_options"));
  result.mode = static_cast<v0::TrackMode>(known.mode);
  result.deterministic = known.deterministic != 0;
  result.relocalize_in_call = known.relocalize_beside_call == 0;
  result.wait_for_matches = known.wait_for_matches != 0;
  return result;
}

absl::StatusOr<v0::Camera> ReadCamera(const cairn_camera* camera) {
  CAIRN_ASSIGN_OR_RETURN(const cairn_camera known, ReadStruct(camera, "cairn_camera"));
  constexpr int kRoom = sizeof(known.distortion) / sizeof(known.distortion[0]);
  if (known.num_distortion < 0 || known.num_distortion > kRoom) {
    return absl::InvalidArgumentError(
        absl::StrCat("cairn_camera: num_distortion is ", known.num_distortion, ", it must be 0 to ", kRoom));
  }
  v0::Camera result;
  result.model = static_cast<v0::CameraModel>(known.model);
  result.width_px = known.width_px;
  result.height_px = known.height_px;
  result.fx_px = known.fx_px;
  result.fy_px = known.fy_px;
  result.cx_px = known.cx_px;
  result.cy_px = known.cy_px;
  result.distortion.assign(known.distortion, known.distortion + known.num_distortion);
  return result;
}

absl::StatusOr<v0::ImageView> ReadImage(const cairn_image* image) {
  CAIRN_ASSIGN_OR_RETURN(const cairn_image known, ReadStruct(image, "cairn_image"));
  CAIRN_RETURN_IF_ERROR(CheckReserved(known.reserved, "cairn_image"));
  v0::ImageView result;
  result.data = known.data;
  result.width_px = known.width_px;
  result.height_px = known.height_px;
  result.stride_bytes = static_cast<std::ptrdiff_t>(known.stride_bytes);
  result.format = static_cast<v0::PixelFormat>(known.format);
  return result;
}

absl::StatusOr<v0::PosePrior> ReadPrior(const cairn_prior* prior) {
  CAIRN_ASSIGN_OR_RETURN(const cairn_prior known, ReadStruct(prior, "cairn_prior"));
  CAIRN_RETURN_IF_ERROR(CheckReserved(static_cast<std::int32_t>(known.reserved), "cairn_prior"));
  v0::PosePrior result;
  const cairn_pose& pose = known.map_from_camera;
  std::copy(std::begin(pose.translation), std::end(pose.translation), result.map_from_camera.translation.begin());
  std::copy(std::begin(pose.rotation_xyzw), std::end(pose.rotation_xyzw), result.map_from_camera.rotation_xyzw.begin());
  result.component = known.component;
  result.position_sigma = known.position_sigma;
  result.rotation_sigma_rad = known.rotation_sigma_rad;
  return result;
}

absl::StatusOr<v0::LocalizeQuery> ReadQuery(const cairn_localize_query* query) {
  CAIRN_ASSIGN_OR_RETURN(const cairn_localize_query known, ReadStruct(query, "cairn_localize_query"));
  v0::LocalizeQuery result;
  CAIRN_ASSIGN_OR_RETURN(result.image, ReadImage(known.image));
  CAIRN_ASSIGN_OR_RETURN(result.camera, ReadCamera(known.camera));
  result.time_ns = known.time_ns;
  if (known.prior != nullptr) {
    CAIRN_ASSIGN_OR_RETURN(result.prior, ReadPrior(known.prior));
  }
  return result;
}

cairn_camera ToC(const v0::Camera& camera) {
  cairn_camera result{};
  result.model = static_cast<std::int32_t>(camera.model);
  result.width_px = camera.width_px;
  result.height_px = camera.height_px;
  constexpr std::size_t kRoom = sizeof(result.distortion) / sizeof(result.distortion[0]);
  const std::size_t count = std::min(camera.distortion.size(), kRoom);
  result.num_distortion = static_cast<std::int32_t>(count);
  result.fx_px = camera.fx_px;
  result.fy_px = camera.fy_px;
  result.cx_px = camera.cx_px;
  result.cy_px = camera.cy_px;
  std::copy_n(camera.distortion.begin(), count, result.distortion);
  return result;
}

cairn_component ToC(const v0::MapComponent& component) {
  cairn_component result{};
  result.id = component.id;
  result.aligned = component.aligned ? 1 : 0;
  result.keyframes = component.keyframes;
  result.world_from_component = PoseToC(component.world_from_component.pose);
  result.scale = component.world_from_component.scale;
  return result;
}

cairn_map_info ToC(const v0::MapInfo& info) {
  cairn_map_info result{};
  WriteString(info.id, result.id, sizeof(result.id));
  WriteString(info.name, result.name, sizeof(result.name));
  result.revision = info.revision;
  result.keyframes = info.keyframes;
  result.points = info.points;
  result.cameras = static_cast<std::int32_t>(info.cameras.size());
  result.components = static_cast<std::int32_t>(info.components.size());
  result.aligned = static_cast<std::int32_t>(std::count_if(info.components.begin(), info.components.end(),
                                                           [](const v0::MapComponent& part) { return part.aligned; }));
  return result;
}

cairn_localize_answer ToC(const v0::LocalizeAnswer& answer) {
  cairn_localize_answer result{};
  result.localized = answer.localized ? 1 : 0;
  result.stage = static_cast<std::int32_t>(answer.stage);
  LocatedToC(answer, &result);
  result.components = answer.components;
  result.reference_keyframe = answer.reference_keyframe;
  result.extract_ms = answer.extract_ms;
  result.locate_ms = answer.locate_ms;
  result.features = answer.counts.features;
  result.candidates = answer.counts.candidates;
  result.word_matches = answer.counts.word_matches;
  result.pnp_inliers = answer.counts.pnp_inliers;
  result.guided_matches = answer.counts.guided_matches;
  result.inliers = answer.counts.inliers;
  result.lens = static_cast<std::int32_t>(answer.lens);
  result.focal_factor = answer.focal_factor;
  result.num_rivals = static_cast<std::int32_t>(answer.rivals.size());
  for (std::size_t i = 0; i < std::min<std::size_t>(answer.rivals.size(), CAIRN_MAX_RIVALS); ++i) {
    const v0::RivalPose& rival = answer.rivals[i];
    result.rivals[i] = {PoseToC(rival.map_from_camera),
                        PoseToC(rival.world_from_camera),
                        v0::PositionSigma(rival.map_from_camera, rival.covariance),
                        v0::RotationSigmaRad(rival.covariance),
                        rival.component,
                        rival.reference_keyframe,
                        rival.inliers,
                        rival.world_is_metric ? 1 : 0};
  }
  return result;
}

cairn_track_answer ToC(const v0::TrackAnswer& answer) {
  cairn_track_answer result{};
  result.time_ns = answer.time_ns;
  result.state = static_cast<std::int32_t>(answer.state);
  LocatedToC(answer, &result);
  result.inliers = answer.inliers;
  result.matched_ns = answer.matched_ns;
  result.track_ms = answer.track_ms;
  WriteString(answer.note, result.note, sizeof(result.note));
  result.connected = answer.connected ? 1 : 0;
  result.map_age_s = answer.map_age_s;
  result.focal_factor = answer.focal_factor;
  return result;
}

}  // namespace cairn::client
