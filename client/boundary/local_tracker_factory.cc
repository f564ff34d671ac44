#include "client/boundary/local_tracker_factory.h"

#include <utility>

#include "client/local_tracker.h"

namespace cairn::client {

absl::StatusOr<std::unique_ptr<api::Tracker>> MakeLocalTracker(MapState& map, const Camera& camera,
                                                               const v0::TrackerOptions& options) {
  LocalTrackerOptions local;
  local.mode = options.mode == v0::TrackMode::kFeatures ? TrackMode::kFeatures : TrackMode::kSemiDirect;
  local.deterministic = options.deterministic;
  local.relocalize_in_call = options.relocalize_in_call;
  local.wait_for_matches = options.wait_for_matches;
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<LocalTracker> tracker, LocalTracker::Open(map.NewReader(), camera, local));
  return tracker;
}

}  // namespace cairn::client
