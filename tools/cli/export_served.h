// cairn --server HOST:PORT export: files that a server makes from a map.
#pragma once

#include <optional>
#include <string>

#include "api/map_admin.h"
#include "base/status.h"
#include "cli/server_option.h"

namespace cairn::cli {

// By the end of its name: .cairn the map, .txt and .tum the poses of its keyframes, .ply its points.
std::optional<api::ExportContent> ContentOfFile(const std::string& path);

// Writes what a map of the server is to `path`, which appears as a whole.
absl::Status ExportServed(const ServerChoice& server, const std::string& map, api::ExportContent content,
                          const std::string& path);

}  // namespace cairn::cli
