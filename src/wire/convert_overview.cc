#include "wire/convert_overview.h"

#include <algorithm>
#include <utility>

#include "wire/convert_map_rows.h"
#include "wire/text.h"

namespace cairn::wire {
namespace {

void Write(const map::MapQuality& quality, v1::MapQuality* out) {
  out->set_keyframes(quality.keyframes);
  out->set_all(quality.all);
  out->set_features(quality.features);
  out->set_points(quality.points);
  out->set_covisible(quality.covisible);
  out->set_observations_per_point(quality.observations_per_point);
  out->set_error_keyframes(quality.error_keyframes);
  out->set_error_rms_px(quality.error_rms_px);
  out->set_error_median_px(quality.error_median_px);
}

map::MapQuality Read(const v1::MapQuality& message) {
  map::MapQuality quality;
  quality.keyframes = message.keyframes();
  quality.all = message.all();
  quality.features = message.features();
  quality.points = message.points();
  quality.covisible = message.covisible();
  quality.observations_per_point = message.observations_per_point();
  quality.error_keyframes = message.error_keyframes();
  quality.error_rms_px = message.error_rms_px();
  quality.error_median_px = message.error_median_px();
  return quality;
}

void Write(const map::KeyframeShare& share, v1::KeyframeShare* out) {
  out->set_session(share.session.value());
  out->set_component(share.component.value());
  out->set_keyframes(share.keyframes);
  out->set_first_ns(share.first_ns);
  out->set_last_ns(share.last_ns);
}

map::KeyframeShare Read(const v1::KeyframeShare& message) {
  return {.session = SessionId(message.session()),
          .component = ComponentId(message.component()),
          .keyframes = message.keyframes(),
          .first_ns = message.first_ns(),
          .last_ns = message.last_ns()};
}

}  // namespace

void ToProto(const map::MapOverview& overview, v1::OverviewMapResponse* out) {
  const map::StoredSummary& summary = overview.summary;
  out->set_format_version(summary.format_version);
  out->set_revision(summary.revision);
  ToProto(summary.info, out->mutable_head());
  out->set_keyframes(summary.keyframes);
  out->set_points(summary.points);
  out->set_file_bytes(summary.file_bytes);
  for (const map::MapCamera& camera : overview.cameras) ToProto(camera, out->add_cameras());
  for (const map::Session& session : overview.sessions) ToProto(session, out->add_sessions());
  for (const map::Component& component : overview.components) ToProto(component, out->add_components());
  for (const map::KeyframeShare& share : overview.shares) Write(share, out->add_shares());
  for (const map::MapPart& part : overview.parts) {
    v1::MapPart* message = out->add_parts();
    message->set_name(part.name);
    message->set_bytes(part.bytes);
  }
  Write(overview.quality, out->mutable_quality());
  out->set_has_vocabulary(overview.has_vocabulary);
  out->set_writing(overview.being_written);
  for (const std::string& note : overview.notes) out->add_notes(Utf8(note));
}

absl::StatusOr<map::MapOverview> FromProto(const v1::OverviewMapResponse& message) {
  map::MapOverview overview;
  map::StoredSummary& summary = overview.summary;
  summary.format_version = message.format_version();
  summary.revision = message.revision();
  CAIRN_ASSIGN_OR_RETURN(summary.info, FromProto(message.head()));
  summary.keyframes = message.keyframes();
  summary.points = message.points();
  summary.file_bytes = message.file_bytes();
  for (const v1::CameraRow& row : message.cameras()) {
    CAIRN_ASSIGN_OR_RETURN(overview.cameras.emplace_back(), FromProto(row));
  }
  for (const v1::SessionRow& row : message.sessions()) overview.sessions.push_back(FromProto(row));
  for (const v1::ComponentRow& row : message.components()) {
    CAIRN_ASSIGN_OR_RETURN(overview.components.emplace_back(), FromProto(row));
  }
  summary.cameras = message.cameras_size();
  summary.sessions = message.sessions_size();
  summary.components = message.components_size();
  for (const v1::KeyframeShare& share : message.shares()) overview.shares.push_back(Read(share));
  for (const v1::MapPart& part : message.parts()) overview.parts.push_back({part.name(), part.bytes()});
  overview.quality = Read(message.quality());
  overview.has_vocabulary = message.has_vocabulary();
  overview.being_written = message.writing();
  overview.notes.assign(message.notes().begin(), message.notes().end());
  return overview;
}

}  // namespace cairn::wire
