#include "wire/convert_admin.h"

#include <algorithm>

#include "wire/convert.h"
#include "wire/text.h"

namespace cairn::wire {
namespace {

void WriteChange(const map::LoggedChange& change, v1::LoggedChange* out) {
  out->set_revision(change.revision);
  out->set_reason(Utf8(change.reason));
  out->set_session(change.session.value());
  out->set_committed_unix_ns(change.committed_unix_ns);
  for (const ComponentId component : change.components) out->add_components(component.value());
  out->set_keyframes_put(change.keyframes_put);
  out->set_keyframes_removed(change.keyframes_removed);
  out->set_points_put(change.points_put);
  out->set_points_removed(change.points_removed);
  out->set_cameras_put(change.cameras_put);
  out->set_cameras_removed(change.cameras_removed);
  out->set_sessions_put(change.sessions_put);
  out->set_components_put(change.components_put);
  out->set_components_removed(change.components_removed);
  out->set_map_put(change.info_put);
}

map::LoggedChange ReadChange(const v1::LoggedChange& message) {
  map::LoggedChange change;
  change.revision = message.revision();
  change.reason = message.reason();
  change.session = SessionId(message.session());
  change.committed_unix_ns = message.committed_unix_ns();
  for (const std::uint32_t component : message.components()) change.components.emplace_back(component);
  change.keyframes_put = message.keyframes_put();
  change.keyframes_removed = message.keyframes_removed();
  change.points_put = message.points_put();
  change.points_removed = message.points_removed();
  change.cameras_put = message.cameras_put();
  change.cameras_removed = message.cameras_removed();
  change.sessions_put = message.sessions_put();
  change.components_put = message.components_put();
  change.components_removed = message.components_removed();
  change.info_put = message.map_put();
  return change;
}

}  // namespace

void ToProto(const api::DeletedMap& map, v1::DeletedMap* out) {
  out->set_deleted(map.deleted);
  out->set_map(map.map);
  out->set_deleted_unix_ns(map.deleted_unix_ns);
  out->set_file_bytes(map.file_bytes);
}

api::DeletedMap FromProto(const v1::DeletedMap& message) {
  return {message.deleted(), message.map(), message.deleted_unix_ns(), message.file_bytes()};
}

void ToProto(const api::MapVerification& verified, v1::VerifyMapResponse* out) {
  if (verified.summary) ToProto(*verified.summary, out->mutable_summary());
  for (const map::Finding& finding : verified.findings) {
    v1::Finding* told = out->add_findings();
    told->set_table(finding.table);
    told->set_id(finding.id);
    told->set_message(Utf8(finding.message));
  }
  for (const std::string& note : verified.notes) out->add_notes(note);
}

absl::StatusOr<api::MapVerification> FromProto(const v1::VerifyMapResponse& message) {
  api::MapVerification verified;
  if (message.has_summary()) {
    CAIRN_ASSIGN_OR_RETURN(verified.summary, FromProto(message.summary()));
  }
  verified.notes.assign(message.notes().begin(), message.notes().end());
  for (const v1::Finding& finding : message.findings()) {
    verified.findings.push_back({finding.table(), finding.id(), finding.message()});
  }
  return verified;
}

absl::StatusOr<map::ChangeQuery> FromProto(const v1::ReadLogRequest& message) {
  if (message.max_count() < 0) return absl::InvalidArgumentError("max_count: must not be negative");
  map::ChangeQuery query;
  query.from_revision = message.from_revision();
  query.session = SessionId(message.session());
  if (message.max_count() > 0) query.max_count = std::min(message.max_count(), map::kMaxLoggedChanges);
  return query;
}

void ToProto(const api::MapLog& log, v1::ReadLogResponse* out) {
  out->set_revision(log.revision);
  for (const map::LoggedChange& change : log.changes) WriteChange(change, out->add_changes());
}

api::MapLog FromProto(const v1::ReadLogResponse& message) {
  api::MapLog log;
  log.revision = message.revision();
  for (const v1::LoggedChange& change : message.changes()) log.changes.push_back(ReadChange(change));
  return log;
}

v1::ExportMapRequest::Content Write(api::ExportContent content) {
  switch (content) {
    case api::ExportContent::kMap:
      return v1::ExportMapRequest::CONTENT_MAP;
    case api::ExportContent::kTrajectory:
      return v1::ExportMapRequest::CONTENT_TRAJECTORY;
    case api::ExportContent::kPoints:
      return v1::ExportMapRequest::CONTENT_POINTS;
  }
  return v1::ExportMapRequest::CONTENT_UNSPECIFIED;
}

absl::StatusOr<api::ExportContent> Read(v1::ExportMapRequest::Content content) {
  switch (content) {
    case v1::ExportMapRequest::CONTENT_MAP:
      return api::ExportContent::kMap;
    case v1::ExportMapRequest::CONTENT_TRAJECTORY:
      return api::ExportContent::kTrajectory;
    case v1::ExportMapRequest::CONTENT_POINTS:
      return api::ExportContent::kPoints;
    default:
      return absl::InvalidArgumentError("content: say what to export: the map, its trajectory, or its points");
  }
}

void ToProto(const api::SessionRemoval& removal, v1::RemoveSessionResponse* out) {
  out->set_revision(removal.revision);
  out->set_session(removal.session.value());
  out->set_keyframes(removal.keyframes);
  out->set_points(removal.points);
  for (const ComponentId id : removal.removed_components) out->add_removed_components(id.value());
  out->set_adjusted_keyframes(removal.adjusted_keyframes);
  out->set_adjustment_rmse_px(removal.adjustment_rmse_px);
  out->set_median_move_share(removal.median_move_share);
}

api::SessionRemoval FromProto(const v1::RemoveSessionResponse& message) {
  api::SessionRemoval removal;
  removal.revision = message.revision();
  removal.session = SessionId(message.session());
  removal.keyframes = message.keyframes();
  removal.points = message.points();
  for (const std::uint32_t id : message.removed_components()) removal.removed_components.emplace_back(id);
  removal.adjusted_keyframes = message.adjusted_keyframes();
  removal.adjustment_rmse_px = message.adjustment_rmse_px();
  removal.median_move_share = message.median_move_share();
  return removal;
}

}  // namespace cairn::wire
