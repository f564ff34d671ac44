#include "wire/convert.h"
#include "wire/convert_alignment.h"
#include "wire/session_names.h"
#include "wire/text.h"

namespace cairn::wire {

void ToProto(const api::MapSummary& summary, v1::MapSummary* out) {
  out->set_name(summary.name);
  out->set_error(Utf8(summary.status.message()));
  out->set_id(summary.id);
  out->set_title(Utf8(summary.title));
  out->set_revision(summary.revision);
  out->set_format_version(summary.format_version);
  out->set_keyframes(summary.keyframes);
  out->set_points(summary.points);
  out->set_cameras(summary.cameras);
  out->set_components(summary.components);
  out->set_sessions(summary.sessions);
  out->set_file_bytes(summary.file_bytes);
  out->set_open(summary.open);
  out->set_writing(summary.writing);
  if (summary.geo_anchor) ToProto(*summary.geo_anchor, out->mutable_geo_anchor());
}

absl::StatusOr<api::MapSummary> FromProto(const v1::MapSummary& message) {
  api::MapSummary summary;
  summary.name = message.name();
  if (!message.error().empty()) summary.status = absl::DataLossError(message.error());
  summary.id = message.id();
  summary.title = message.title();
  summary.revision = message.revision();
  summary.format_version = message.format_version();
  summary.keyframes = message.keyframes();
  summary.points = message.points();
  summary.cameras = message.cameras();
  summary.components = message.components();
  summary.sessions = message.sessions();
  summary.file_bytes = message.file_bytes();
  summary.open = message.open();
  summary.writing = message.writing();
  if (message.has_geo_anchor()) {
    CAIRN_ASSIGN_OR_RETURN(summary.geo_anchor, FromProto(message.geo_anchor()));
  }
  return summary;
}

void ToProto(const api::MapDescription& description, v1::DescribeMapResponse* out) {
  ToProto(description.summary, out->mutable_summary());
  for (const api::CameraInfo& camera : description.cameras) {
    v1::CameraInfo* info = out->add_cameras();
    info->set_id(camera.id.value());
    info->set_name(Utf8(camera.name));
    ToProto(camera.camera, info->mutable_camera());
    info->set_lens_corrected(camera.lens_corrected);
  }
  for (const api::ComponentInfo& component : description.components) {
    v1::ComponentInfo* info = out->add_components();
    info->set_id(component.id.value());
    info->set_session(component.session.value());
    info->set_keyframes(component.keyframes);
    if (component.world_from_component) ToProto(*component.world_from_component, info->mutable_world_from_component());
    info->set_joined_into(component.joined_into.value());
  }
  for (const map::Session& session : description.sessions) Write(session, out->add_sessions());
  ToProto(description.orb, out->mutable_orb());
}

absl::StatusOr<api::MapDescription> FromProto(const v1::DescribeMapResponse& message) {
  api::MapDescription description;
  CAIRN_ASSIGN_OR_RETURN(description.summary, FromProto(message.summary()));
  for (const v1::CameraInfo& info : message.cameras()) {
    api::CameraInfo camera;
    camera.id = CameraId(info.id());
    camera.name = info.name();
    CAIRN_ASSIGN_OR_RETURN(camera.camera, FromProto(info.camera()));
    camera.lens_corrected = info.lens_corrected();
    description.cameras.push_back(std::move(camera));
  }
  for (const v1::ComponentInfo& info : message.components()) {
    api::ComponentInfo component;
    component.id = ComponentId(info.id());
    component.session = SessionId(info.session());
    component.keyframes = info.keyframes();
    if (info.has_world_from_component()) {
      CAIRN_ASSIGN_OR_RETURN(component.world_from_component, FromProto(info.world_from_component()));
    }
    component.joined_into = ComponentId(info.joined_into());
    description.components.push_back(component);
  }
  for (const v1::SessionInfo& session : message.sessions()) description.sessions.push_back(Read(session));
  if (message.has_orb()) {  // servers of before do not say
    CAIRN_ASSIGN_OR_RETURN(description.orb, FromProto(message.orb()));
  }
  return description;
}

}  // namespace cairn::wire
