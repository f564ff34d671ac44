// How a server is doing, as cairn top shows it: what happened between two looks at it.
#pragma once

#include <string>
#include <vector>

#include "api/server_status.h"
#include "cli/cli.h"

namespace cairn::cli {

// For a terminal lines of at most 80 columns, else nothing is cut. `before`: an earlier look at the same server,
// `seconds` ago; with null and its uptime: everything since its start.
std::vector<std::string> StatusLines(const std::string& server, const api::ServerStatus& now,
                                     const api::ServerStatus* before, double seconds, bool terminal);

nlohmann::ordered_json StatusAsJson(const std::string& server, const api::ServerStatus& now,
                                    const api::ServerStatus* before, double seconds);

}  // namespace cairn::cli
