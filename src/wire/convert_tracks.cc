#include "wire/convert_tracks.h"

#include "wire/convert.h"
#include "wire/reading.h"

namespace cairn::wire {
namespace {

v1::TrackAnswer::State WriteTrackState(api::TrackState state) {
  switch (state) {
    case api::TrackState::kLocated:
      return v1::TrackAnswer::STATE_LOCATED;
    case api::TrackState::kTracked:
      return v1::TrackAnswer::STATE_TRACKED;
    case api::TrackState::kCarried:
      return v1::TrackAnswer::STATE_CARRIED;
    case api::TrackState::kLost:
      return v1::TrackAnswer::STATE_LOST;
  }
  return v1::TrackAnswer::STATE_UNSPECIFIED;
}

api::TrackState ReadTrackState(v1::TrackAnswer::State state) {
  switch (state) {
    case v1::TrackAnswer::STATE_LOCATED:
      return api::TrackState::kLocated;
    case v1::TrackAnswer::STATE_TRACKED:
      return api::TrackState::kTracked;
    case v1::TrackAnswer::STATE_CARRIED:
      return api::TrackState::kCarried;
    default:
      return api::TrackState::kLost;
  }
}

}  // namespace

void ToProto(const api::TrackAnswer& answer, v1::TrackAnswer* out) {
  out->set_time_ns(answer.time_ns);
  out->set_state(WriteTrackState(answer.state));
  out->set_reason(answer.reason);
  out->set_map_id(answer.map_id);
  out->set_revision(answer.revision);
  out->set_matched_ns(answer.matched_ns);
  out->set_inliers(answer.inliers);
  out->set_note(answer.note);
  out->set_map_damaged(answer.map_damaged);
  out->set_track_ms(answer.track_ms);
  out->set_focal_factor(answer.focal_factor);
  if (answer.state == api::TrackState::kLost) return;
  ToProto(answer.map_from_camera, out->mutable_map_from_camera());
  out->set_component(answer.component.value());
  ToProto(answer.world_from_camera, out->mutable_world_from_camera());
  out->set_world_per_map(answer.world_per_map);
  out->set_world_is_metric(answer.world_is_metric);
  Write(answer.covariance, out->mutable_covariance());
}

absl::StatusOr<api::TrackAnswer> FromProto(const v1::TrackAnswer& message) {
  if (!message.error_reason().empty()) return absl::InvalidArgumentError(message.error_message());
  api::TrackAnswer answer;
  answer.time_ns = message.time_ns();
  answer.state = ReadTrackState(message.state());
  answer.reason = message.reason();
  answer.map_id = message.map_id();
  answer.revision = message.revision();
  answer.matched_ns = message.matched_ns();
  answer.inliers = message.inliers();
  answer.note = message.note();
  answer.map_damaged = message.map_damaged();
  answer.track_ms = message.track_ms();
  if (message.focal_factor() > 0.0) answer.focal_factor = message.focal_factor();
  if (answer.state == api::TrackState::kLost) return answer;
  CAIRN_ASSIGN_OR_RETURN(answer.map_from_camera, FromProto(message.map_from_camera()));
  answer.component = ComponentId(message.component());
  CAIRN_ASSIGN_OR_RETURN(answer.world_from_camera, FromProto(message.world_from_camera()));
  answer.world_per_map = message.world_per_map();
  answer.world_is_metric = message.world_is_metric();
  CAIRN_ASSIGN_OR_RETURN(answer.covariance, ReadMatrix(message.covariance()));
  return answer;
}

}  // namespace cairn::wire
