// What a map file says of its health and its past.
#pragma once

#include <string>

#include "api/map_service.h"
#include "base/status.h"
#include "map/overview.h"

namespace cairn::host {

// `map`: its name in the answer. Reads all of the revision that is durable now.
absl::StatusOr<api::MapVerification> VerifyMap(const std::string& map, const std::string& uri, api::VerifyDepth depth);

// store::ReadMapOverview, and whether some process writes the map. Of a map whose vocabulary is not in the file a note
// says where it comes from, or the error why there is none.
absl::StatusOr<map::MapOverview> ReadOverview(const std::string& uri);

// NotFound for a session that the map does not have.
absl::StatusOr<api::MapLog> ReadMapLog(const std::string& uri, const map::ChangeQuery& query);

}  // namespace cairn::host
