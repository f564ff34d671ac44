// Files made from a map, for other programs.
#pragma once

#include <string>

#include "api/map_admin.h"
#include "base/status.h"

namespace cairn::host {

// Writes the newest durable revision of the map at `uri` to `path`, while others may go on writing it. AlreadyExists if
// there is a file; FailedPrecondition if the map has no keyframe to make it from.
absl::Status ExportMap(const std::string& uri, api::ExportContent content, const std::string& path);

// The same, without leaving a file: `scratch` names one that does not exist, and does not afterwards.
absl::Status ExportMapTo(const std::string& uri, api::ExportContent content, const std::string& scratch,
                         const api::ExportSink& sink);

}  // namespace cairn::host
