#include "cli/track_target.h"

#include <utility>

#include "cli/server_option.h"
#include "client/local_tracker.h"

namespace cairn::cli {
namespace {

// Its service goes with it.
struct ServedTracker final : public api::Tracker {
  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& frame) override { return tracker->Track(frame); }

  std::unique_ptr<client::RemoteMapService> service;
  std::unique_ptr<api::Tracker> tracker;
};

}  // namespace

absl::StatusOr<TrackTarget> OpenTrackTarget(const std::string& server, const std::string& map, const Camera& camera,
                                            const client::LocalTrackerOptions& options) {
  if (server.empty()) {
    CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<client::LocalTracker> tracker,
                           client::LocalTracker::Open(map, camera, options));
    return TrackTarget{tracker, [tracker] { return CommonFrameOf(tracker->snapshot()); }};
  }
  auto served = std::make_shared<ServedTracker>();
  CAIRN_ASSIGN_OR_RETURN(served->service, ConnectTo(server));
  CAIRN_ASSIGN_OR_RETURN(served->tracker, served->service->NewTracker(map, camera));
  return TrackTarget{served, [served, map]() -> absl::StatusOr<CommonFrame> {
                       CAIRN_ASSIGN_OR_RETURN(const api::MapDescription now, served->service->Describe(map));
                       return CommonFrameOf(now);
                     }};
}

}  // namespace cairn::cli
