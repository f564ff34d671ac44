// What verbs say of the maps of a directory or of a server.
#pragma once

#include "api/map_service.h"
#include "cli/cli.h"

namespace cairn::cli {

nlohmann::ordered_json SummaryAsJson(const api::MapSummary& map);

}  // namespace cairn::cli
