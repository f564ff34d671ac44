// What keeps maps and changes them, as one client may.
#include "server/access/authorized_maps.h"

namespace cairn::server {

absl::StatusOr<std::vector<api::ActiveSession>> AuthorizedMaps::Sessions(const std::string& map) {
  if (!map.empty()) CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  CAIRN_ASSIGN_OR_RETURN(std::vector<api::ActiveSession> sessions, maps_.Sessions(map));
  CAIRN_RETURN_IF_ERROR(
      KeepAllowed(Right::kRead, &sessions, [](const api::ActiveSession& session) { return session.map; }));
  return sessions;
}

absl::StatusOr<api::MapSummary> AuthorizedMaps::Create(const std::string& map, const std::string& title) {
  return Changing(Right::kExtend, "map_created", map, [&] { return maps_.Create(map, title); });
}

absl::StatusOr<api::MapSummary> AuthorizedMaps::Snapshot(const std::string& map, const std::string& as) {
  return Changing(Right::kAdmin, "map_copied", as, [&]() -> absl::StatusOr<api::MapSummary> {
    CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
    return maps_.Snapshot(map, as);
  });
}

absl::StatusOr<std::string> AuthorizedMaps::Delete(const std::string& map) {
  return Changing(Right::kAdmin, "map_deleted", map, [&] { return maps_.Delete(map); });
}

absl::StatusOr<std::vector<api::DeletedMap>> AuthorizedMaps::ListDeleted() {
  CAIRN_ASSIGN_OR_RETURN(std::vector<api::DeletedMap> maps, maps_.ListDeleted());
  CAIRN_RETURN_IF_ERROR(KeepAllowed(Right::kAdmin, &maps, [](const api::DeletedMap& map) { return map.map; }));
  return maps;
}

absl::StatusOr<std::string> AuthorizedMaps::Restore(const std::string& deleted, const std::string& as) {
  CAIRN_ASSIGN_OR_RETURN(const api::DeletedName had, api::ParseDeletedName(deleted));
  return Changing(Right::kAdmin, "map_restored", had.map, [&]() -> absl::StatusOr<std::string> {
    if (!as.empty()) CAIRN_RETURN_IF_ERROR(Require(Right::kAdmin, as));
    return maps_.Restore(deleted, as);
  });
}

absl::StatusOr<api::MapVerification> AuthorizedMaps::Verify(const std::string& map, api::VerifyDepth depth) {
  CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  return maps_.Verify(map, depth);
}

absl::StatusOr<api::AlignAnswer> AuthorizedMaps::Align(const std::string& map, const api::AlignRequest& request) {
  return Changing(Right::kAdmin, "map_aligned", map, [&] { return maps_.Align(map, request); });
}

absl::StatusOr<api::SessionRemoval> AuthorizedMaps::RemoveSession(const std::string& map, SessionId session) {
  return Changing(Right::kAdmin, "session_removed", map, [&] { return maps_.RemoveSession(map, session); });
}

absl::StatusOr<api::MapLog> AuthorizedMaps::Log(const std::string& map, const map::ChangeQuery& query) {
  CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  return maps_.Log(map, query);
}

absl::Status AuthorizedMaps::Export(const std::string& map, api::ExportContent content, const api::ExportSink& sink) {
  CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  return maps_.Export(map, content, sink);
}

}  // namespace cairn::server
