#include "wire/convert_sessions.h"

#include <utility>

#include "wire/convert.h"
#include "wire/session_names.h"
#include "wire/text.h"

namespace cairn::wire {

void ToProto(const api::SessionRequest& request, v1::StartSession* out) {
  out->set_map(request.map);
  out->set_policy(Write(request.policy));
  ToProto(request.camera, out->mutable_camera());
  out->set_camera_name(Utf8(request.camera_name));
  out->set_source(Utf8(request.source));
  out->set_title(Utf8(request.title));
  out->set_first_ns(request.first_ns);
  out->set_map_id(request.map_id);
  out->set_least_revision(request.least_revision);
}

absl::StatusOr<api::SessionRequest> FromProto(const v1::StartSession& message) {
  api::SessionRequest request;
  request.map = message.map();
  switch (message.policy()) {
    case v1::SessionInfo::POLICY_CREATE:
      request.policy = map::SessionPolicy::kCreate;
      break;
    case v1::SessionInfo::POLICY_EXTEND:
      request.policy = map::SessionPolicy::kExtend;
      break;
    default:
      return absl::InvalidArgumentError("policy: say whether the session creates the map or extends it");
  }
  CAIRN_ASSIGN_OR_RETURN(request.camera, FromProto(message.camera()));
  request.camera_name = message.camera_name();
  request.source = message.source();
  request.title = message.title();
  request.first_ns = message.first_ns();
  request.map_id = message.map_id();
  request.least_revision = message.least_revision();
  return request;
}

void ToProto(const api::SessionAnswer& answer, v1::FrameAnswer* out) {
  out->set_time_ns(answer.time_ns);
  out->set_state(Write(answer.state));
  out->set_reason(answer.reason);
  if (!answer.map_from_camera) return;
  ToProto(*answer.map_from_camera, out->mutable_map_from_camera());
  out->set_component(answer.component.value());
  if (answer.world_from_component) ToProto(*answer.world_from_component, out->mutable_world_from_component());
}

absl::StatusOr<api::SessionAnswer> FromProto(const v1::FrameAnswer& message) {
  if (!message.error_reason().empty()) return absl::InvalidArgumentError(message.error_message());
  api::SessionAnswer answer;
  answer.time_ns = message.time_ns();
  answer.state = ReadState(message.state());
  answer.reason = message.reason();
  if (!message.has_map_from_camera()) return answer;
  CAIRN_ASSIGN_OR_RETURN(answer.map_from_camera, FromProto(message.map_from_camera()));
  answer.component = ComponentId(message.component());
  if (message.has_world_from_component()) {
    CAIRN_ASSIGN_OR_RETURN(answer.world_from_component, FromProto(message.world_from_component()));
  }
  return answer;
}

void ToProto(const api::SessionProgress& progress, v1::SessionProgress* out) {
  out->set_session(progress.session.value());
  out->set_revision(progress.revision);
  out->set_keyframes(progress.keyframes);
  out->set_has_durable(progress.durable_ns.has_value());
  out->set_durable_ns(progress.durable_ns.value_or(0));
  out->set_component(progress.component.value());
  out->set_located(progress.located_ns.has_value());
  out->set_located_ns(progress.located_ns.value_or(0));
  out->set_located_component(progress.located_component.value());
  out->set_joined(progress.joined_ns.has_value());
  out->set_joined_ns(progress.joined_ns.value_or(0));
}

api::SessionProgress FromProto(const v1::SessionProgress& message) {
  api::SessionProgress progress;
  progress.session = SessionId(message.session());
  progress.revision = message.revision();
  progress.keyframes = message.keyframes();
  if (message.has_durable()) progress.durable_ns = message.durable_ns();
  progress.component = ComponentId(message.component());
  if (message.located()) progress.located_ns = message.located_ns();
  progress.located_component = ComponentId(message.located_component());
  if (message.joined()) progress.joined_ns = message.joined_ns();
  return progress;
}

void ToProto(const api::SessionSummary& summary, v1::SessionSummary* out) {
  out->set_session(summary.session.value());
  out->set_frames(summary.frames);
  out->set_frames_tracked(summary.frames_tracked);
  out->set_keyframes(summary.keyframes);
  out->set_points(summary.points);
  out->set_result(Write(summary.result));
  out->set_joins(summary.joins);
  out->set_loops(summary.loops);
  out->set_revision(summary.revision);
  out->set_component(summary.component.value());
  if (summary.world_from_component) ToProto(*summary.world_from_component, out->mutable_world_from_component());
  for (const api::SessionSummary::Pose& pose : summary.poses) {
    v1::FinalPose* final_pose = out->add_poses();
    final_pose->set_time_ns(pose.time_ns);
    ToProto(pose.map_from_camera, final_pose->mutable_map_from_camera());
  }
}

absl::StatusOr<api::SessionSummary> FromProto(const v1::SessionSummary& message) {
  api::SessionSummary summary;
  summary.session = SessionId(message.session());
  summary.frames = message.frames();
  summary.frames_tracked = message.frames_tracked();
  summary.keyframes = message.keyframes();
  summary.points = message.points();
  summary.result = ReadResult(message.result());
  summary.joins = message.joins();
  summary.loops = message.loops();
  summary.revision = message.revision();
  summary.component = ComponentId(message.component());
  if (message.has_world_from_component()) {
    CAIRN_ASSIGN_OR_RETURN(summary.world_from_component, FromProto(message.world_from_component()));
  }
  for (const v1::FinalPose& pose : message.poses()) {
    CAIRN_ASSIGN_OR_RETURN(const SE3 map_from_camera, FromProto(pose.map_from_camera()));
    summary.poses.push_back({pose.time_ns(), map_from_camera});
  }
  return summary;
}

}  // namespace cairn::wire
