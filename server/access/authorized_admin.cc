// What keeps maps and changes them, as one client may.
#include <nlohmann/json.hpp>

#include "server/access/authorized_maps.h"

namespace cairn::server {
namespace {

using nlohmann::ordered_json;

std::string Named(const char* key, const std::string& name) {
  return ordered_json{{key, name}}.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

std::string DetailsOf(const api::AlignAnswer& answer) {
  ordered_json details{{"revision", answer.revision}};
  if (answer.component) {
    details["component"] = answer.component->component.value();
    details["scale"] = answer.component->world_from_component.scale();
  }
  if (answer.geo_anchor_changed && answer.geo_anchor) {
    details["geo_anchor"] = {{"latitude_deg", answer.geo_anchor->latitude_deg},
                             {"longitude_deg", answer.geo_anchor->longitude_deg},
                             {"height_m", answer.geo_anchor->height_m}};
  }
  return details.dump();
}

}  // namespace

absl::StatusOr<std::vector<api::ActiveSession>> AuthorizedMaps::Sessions(const std::string& map) {
  if (!map.empty()) CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  CAIRN_ASSIGN_OR_RETURN(std::vector<api::ActiveSession> sessions, maps_.Sessions(map));
  CAIRN_RETURN_IF_ERROR(
      KeepAllowed(Right::kRead, &sessions, [](const api::ActiveSession& session) { return session.map; }));
  return sessions;
}

absl::StatusOr<api::MapSummary> AuthorizedMaps::Create(const std::string& map, const std::string& title) {
  return Changing(
      Right::kExtend, "map_created", map, [&] { return maps_.Create(map, title); },
      [](const auto&) { return std::string(); });
}

absl::StatusOr<api::MapSummary> AuthorizedMaps::Snapshot(const std::string& map, const std::string& as) {
  return Changing(
      Right::kAdmin, "map_copied", as,
      [&]() -> absl::StatusOr<api::MapSummary> {
        CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
        return maps_.Snapshot(map, as);
      },
      [&](const auto&) { return Named("copy_of", map); });
}

absl::StatusOr<std::string> AuthorizedMaps::Delete(const std::string& map) {
  return Changing(
      Right::kAdmin, "map_deleted", map, [&] { return maps_.Delete(map); },
      [](const std::string& deleted) { return Named("in_trash", deleted); });
}

absl::StatusOr<std::vector<api::DeletedMap>> AuthorizedMaps::ListDeleted() {
  CAIRN_ASSIGN_OR_RETURN(std::vector<api::DeletedMap> maps, maps_.ListDeleted());
  CAIRN_RETURN_IF_ERROR(KeepAllowed(Right::kAdmin, &maps, [](const api::DeletedMap& map) { return map.map; }));
  return maps;
}

absl::StatusOr<std::string> AuthorizedMaps::Restore(const std::string& deleted, const std::string& as) {
  CAIRN_ASSIGN_OR_RETURN(const api::DeletedName had, api::ParseDeletedName(deleted));
  return Changing(
      Right::kAdmin, "map_restored", had.map,
      [&]() -> absl::StatusOr<std::string> {
        if (!as.empty()) CAIRN_RETURN_IF_ERROR(Require(Right::kAdmin, as));
        return maps_.Restore(deleted, as);
      },
      [](const std::string& name) { return Named("as", name); });
}

absl::StatusOr<api::MapVerification> AuthorizedMaps::Verify(const std::string& map, api::VerifyDepth depth) {
  CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  return maps_.Verify(map, depth);
}

absl::StatusOr<api::AlignAnswer> AuthorizedMaps::Align(const std::string& map, const api::AlignRequest& request) {
  return Changing(
      Right::kAdmin, "map_aligned", map, [&] { return maps_.Align(map, request); }, DetailsOf);
}

absl::StatusOr<api::SessionRemoval> AuthorizedMaps::RemoveSession(const std::string& map, SessionId session) {
  return Changing(
      Right::kAdmin, "session_removed", map, [&] { return maps_.RemoveSession(map, session); },
      [&](const api::SessionRemoval& removal) {
        return ordered_json{{"session", session.value()}, {"revision", removal.revision}}.dump();
      });
}

absl::StatusOr<map::MapOverview> AuthorizedMaps::Overview(const std::string& map) {
  CAIRN_RETURN_IF_ERROR(Require(Right::kRead, map));
  return maps_.Overview(map);
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
