// Takes a session out of a map: its keyframes go, and the points that nobody else sees; what the others saw stays, and
// is adjusted again without it. One change of the head, whoever else is extending the map.
#pragma once

#include <string>

#include "api/map_admin.h"
#include "base/status.h"
#include "engine/live_map.h"

namespace cairn::care {

// Durable on return; after an error the map is as it was. `map`: how messages name it. NotFound for a session that
// there is not, FailedPrecondition for one that was removed already. Nobody may be adding to the session.
//
// A component that was the session's alone goes as a whole. Elsewhere the tree gets another root where the session made
// it. Of a component that is aligned to the world the adjustment is laid back onto where its keyframes were.
absl::StatusOr<api::SessionRemoval> RemoveSession(const std::string& map, SessionId session, engine::LiveMap& live);

}  // namespace cairn::care
