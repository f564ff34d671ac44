// What those who keep maps ask of a server.
#include "client/remote/stubs.h"
#include "wire/convert.h"
#include "wire/convert_admin.h"
#include "wire/convert_alignment.h"
#include "wire/convert_overview.h"
#include "wire/convert_status.h"

namespace cairn::client {

absl::StatusOr<std::vector<api::ActiveSession>> RemoteMapService::Sessions(const std::string& map) {
  if (!map.empty()) CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  v1::ListSessionsRequest request;
  request.set_map(map);
  v1::ListSessionsResponse response;
  CAIRN_RETURN_IF_ERROR(
      stubs_->Read([&](auto* call) { return stubs_->sessions->ListSessions(call, request, &response); }));
  std::vector<api::ActiveSession> sessions;
  for (const v1::ActiveSession& session : response.sessions()) sessions.push_back(wire::FromProto(session));
  return sessions;
}

absl::StatusOr<api::ServerStatus> RemoteMapService::Status() {
  v1::GetStatusResponse response;
  CAIRN_RETURN_IF_ERROR(stubs_->Call([&](auto* call) { return stubs_->status->GetStatus(call, {}, &response); }));
  return wire::FromProto(response);
}

absl::StatusOr<api::MapSummary> RemoteMapService::Create(const std::string& map, const std::string& title) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  v1::CreateMapRequest request;
  request.set_map(map);
  request.set_title(title);
  v1::CreateMapResponse response;
  CAIRN_RETURN_IF_ERROR(stubs_->Call([&](auto* call) { return stubs_->admin->CreateMap(call, request, &response); }));
  return wire::FromProto(response.summary());
}

absl::StatusOr<api::MapSummary> RemoteMapService::Snapshot(const std::string& map, const std::string& as) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(as));
  v1::SnapshotMapRequest request;
  request.set_map(map);
  request.set_as(as);
  v1::SnapshotMapResponse response;
  CAIRN_RETURN_IF_ERROR(
      stubs_->LongCall([&](auto* call) { return stubs_->admin->SnapshotMap(call, request, &response); }));
  return wire::FromProto(response.summary());
}

absl::StatusOr<std::string> RemoteMapService::Delete(const std::string& map) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  v1::DeleteMapRequest request;
  request.set_map(map);
  v1::DeleteMapResponse response;
  CAIRN_RETURN_IF_ERROR(stubs_->Call([&](auto* call) { return stubs_->admin->DeleteMap(call, request, &response); }));
  return response.deleted();
}

absl::StatusOr<std::vector<api::DeletedMap>> RemoteMapService::ListDeleted() {
  v1::ListDeletedMapsResponse response;
  CAIRN_RETURN_IF_ERROR(stubs_->Read([&](auto* call) { return stubs_->admin->ListDeletedMaps(call, {}, &response); }));
  std::vector<api::DeletedMap> maps;
  for (const v1::DeletedMap& map : response.maps()) maps.push_back(wire::FromProto(map));
  return maps;
}

absl::StatusOr<std::string> RemoteMapService::Restore(const std::string& deleted, const std::string& as) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(deleted));  // what is no text cannot be sent as one
  if (!as.empty()) CAIRN_RETURN_IF_ERROR(api::CheckMapName(as));
  v1::RestoreMapRequest request;
  request.set_deleted(deleted);
  request.set_as(as);
  v1::RestoreMapResponse response;
  CAIRN_RETURN_IF_ERROR(stubs_->Call([&](auto* call) { return stubs_->admin->RestoreMap(call, request, &response); }));
  return response.map();
}

absl::StatusOr<api::MapVerification> RemoteMapService::Verify(const std::string& map, api::VerifyDepth depth) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  v1::VerifyMapRequest request;
  request.set_map(map);
  request.set_deep(depth == api::VerifyDepth::kDeep);
  v1::VerifyMapResponse response;
  CAIRN_RETURN_IF_ERROR(
      stubs_->LongRead([&](auto* call) { return stubs_->admin->VerifyMap(call, request, &response); }));
  return wire::FromProto(response);
}

absl::StatusOr<api::AlignAnswer> RemoteMapService::Align(const std::string& map, const api::AlignRequest& request) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  CAIRN_RETURN_IF_ERROR(request.Validate());
  v1::AlignMapRequest message;
  message.set_map(map);
  wire::ToProto(request, &message);
  v1::AlignMapResponse response;
  CAIRN_RETURN_IF_ERROR(
      stubs_->LongCall([&](auto* call) { return stubs_->admin->AlignMap(call, message, &response); }));
  return wire::FromProto(response);
}

absl::StatusOr<api::SessionRemoval> RemoteMapService::RemoveSession(const std::string& map, SessionId session) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  v1::RemoveSessionRequest request;
  request.set_map(map);
  request.set_session(session.value());
  v1::RemoveSessionResponse response;
  CAIRN_RETURN_IF_ERROR(
      stubs_->LongCall([&](auto* call) { return stubs_->admin->RemoveSession(call, request, &response); }));
  return wire::FromProto(response);
}

absl::StatusOr<map::MapOverview> RemoteMapService::Overview(const std::string& map) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  v1::OverviewMapRequest request;
  request.set_map(map);
  v1::OverviewMapResponse response;
  CAIRN_RETURN_IF_ERROR(stubs_->Read([&](auto* call) { return stubs_->admin->OverviewMap(call, request, &response); }));
  return wire::FromProto(response);
}

absl::StatusOr<api::MapLog> RemoteMapService::Log(const std::string& map, const map::ChangeQuery& query) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  v1::ReadLogRequest request;
  request.set_map(map);
  request.set_from_revision(query.from_revision);
  request.set_session(query.session.value());
  request.set_max_count(query.max_count);
  v1::ReadLogResponse response;
  CAIRN_RETURN_IF_ERROR(stubs_->Read([&](auto* call) { return stubs_->admin->ReadLog(call, request, &response); }));
  return wire::FromProto(response);
}

absl::Status RemoteMapService::Export(const std::string& map, api::ExportContent content, const api::ExportSink& sink) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(map));
  v1::ExportMapRequest request;
  request.set_map(map);
  request.set_content(wire::Write(content));
  absl::Status taken;
  const absl::Status sent = stubs_->LongCall([&](grpc::ClientContext* call) {
    const auto reader = stubs_->admin->ExportMap(call, request);
    v1::ExportMapResponse response;
    while (taken.ok() && reader->Read(&response)) taken = sink(response.part());
    if (!taken.ok()) call->TryCancel();
    return reader->Finish();
  });
  return taken.ok() ? sent : taken;
}

}  // namespace cairn::client
