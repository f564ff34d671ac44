#include "client/boundary/local_tracker_factory.h"

namespace cairn::client {

absl::StatusOr<std::unique_ptr<api::Tracker>> MakeLocalTracker(MapState& map, const Camera& /*camera*/,
                                                               const v0::TrackerOptions& /*options*/) {
  return absl::UnimplementedError(
      absl::StrCat(map.path(), ": this version cannot track from image to image yet; use a Localizer"));
}

}  // namespace cairn::client
