#include "cli/track_target.h"

#include <utility>

#include "client/local_tracker.h"
#include "client/remote/remote_map_service.h"

namespace cairn::cli {
namespace {

// Its service goes with it.
struct TrackerAndService final : public api::Tracker {
  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& frame) override { return tracker->Track(frame); }

  std::unique_ptr<client::RemoteMapService> service;
  std::unique_ptr<api::Tracker> tracker;
};

}  // namespace

absl::StatusOr<TrackTarget> OpenTrackTarget(const ServerChoice& server, const std::string& map, const Camera& camera,
                                            const client::LocalTrackerOptions& options, bool at_server) {
  if (server.empty()) {
    CAIRN_ASSIGN_OR_RETURN(std::shared_ptr<client::LocalTracker> tracker,
                           client::LocalTracker::Open(map, camera, options));
    return TrackTarget{tracker, [tracker] { return CommonFrameOf(tracker->snapshot()); }};
  }
  CAIRN_ASSIGN_OR_RETURN(client::RemoteOptions remote, RemoteOptionsOf(server));
  remote.tracker = options;
  remote.track_at = at_server ? client::TrackAt::kServer : client::TrackAt::kClient;
  auto served = std::make_shared<TrackerAndService>();
  CAIRN_ASSIGN_OR_RETURN(served->service, client::RemoteMapService::Connect(remote));
  CAIRN_ASSIGN_OR_RETURN(served->tracker, served->service->NewTracker(map, camera));
  return TrackTarget{served, [served, map]() -> absl::StatusOr<CommonFrame> {
                       CAIRN_ASSIGN_OR_RETURN(const api::MapDescription now, served->service->Describe(map));
                       return CommonFrameOf(now);
                     }};
}

}  // namespace cairn::cli
