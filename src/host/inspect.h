// What a map file says of its health and its past.
#pragma once

#include <string>

#include "api/map_service.h"
#include "base/status.h"

namespace cairn::host {

// `map`: its name in the answer. Reads all of the revision that is durable now.
absl::StatusOr<api::MapVerification> VerifyMap(const std::string& map, const std::string& uri, api::VerifyDepth depth);

// NotFound for a session that the map does not have.
absl::StatusOr<api::MapLog> ReadMapLog(const std::string& uri, const map::ChangeQuery& query);

}  // namespace cairn::host
