// "Where is this photo?", asked of several maps of a server.
#pragma once

#include <string>
#include <vector>

#include "api/localizer.h"
#include "base/status.h"
#include "cli/server_option.h"

namespace cairn::cli {

// Prints which of the maps (none: all of the server) the image is of, with the pose there. The exit code.
absl::StatusOr<int> LocalizeAcrossMaps(const ServerChoice& server, const std::vector<std::string>& maps,
                                       const api::LocalizeQuery& query, const std::string& image, bool json);

}  // namespace cairn::cli
