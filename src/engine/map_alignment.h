// Gives a map its place in the world and on the earth, in one change of its head, whoever else is extending it.
// docs/alignment.md says what is estimated, and what is refused.
#pragma once

#include <string>

#include "api/map_alignment.h"
#include "base/status.h"
#include "engine/live_map.h"

namespace cairn::engine {

// Durable on return; after an error the map is as it was. `map`: how messages name it. InvalidArgument for a request
// that makes no sense, NotFound for a component, session or keyframe that there is not, AlreadyExists for what would
// have to be overwritten, FailedPrecondition for a reference that does not fit or leaves something open.
absl::StatusOr<api::AlignAnswer> AlignMap(const std::string& map, const api::AlignRequest& request, LiveMap& live);

}  // namespace cairn::engine
