// What `cairn track` asks: a map file in this process, or a map of a server.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "api/tracker.h"
#include "base/status.h"
#include "cli/common_frame.h"
#include "cli/server_option.h"
#include "client/local_tracker_options.h"
#include "geometry/camera.h"

namespace cairn::cli {

struct TrackTarget {
  std::shared_ptr<api::Tracker> tracker;
  // As the tracker's last answer saw the map; a server is asked.
  std::function<absl::StatusOr<CommonFrame>()> frame;
};

// `server` empty: `map` is a file. The options are those of a tracker in this process; `at_server`: the server tracks,
// in its own way.
absl::StatusOr<TrackTarget> OpenTrackTarget(const ServerChoice& server, const std::string& map, const Camera& camera,
                                            const client::LocalTrackerOptions& options, bool at_server);

}  // namespace cairn::cli
