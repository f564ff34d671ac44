// Where the trackers of the public library come from.
#pragma once

#include <memory>

#include "api/tracker.h"
#include "base/status.h"
#include "cairn/tracker.h"
#include "client/boundary/map_state.h"
#include "geometry/camera.h"

namespace cairn::client {

// A tracker in the map of `map`. It may be given images of a size that is not the camera's, and refuses them.
absl::StatusOr<std::unique_ptr<api::Tracker>> MakeLocalTracker(MapState& map, const Camera& camera,
                                                               const v0::TrackerOptions& options);

}  // namespace cairn::client
