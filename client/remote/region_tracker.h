// Tracking at the client in a map that is too large to be kept there: a part of it around the camera is, and moves
// along with it. A camera that is lost in that part is looked for in the whole map by the server, one image at a time
// and not often; no other frame is sent.
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "api/localizer.h"
#include "api/tracker.h"
#include "base/frame_times.h"
#include "base/status.h"
#include "client/local_tracker.h"
#include "client/remote/followed_map.h"

namespace cairn::client {

class RegionTracker final : public api::Tracker {
 public:
  // What it asks the server for.
  struct Server {
    std::function<absl::StatusOr<api::LocalizeAnswer>(const api::LocalizeQuery& query)> localize;
    std::function<absl::StatusOr<std::shared_ptr<FollowedMap>>(const map::RegionQuery& region)> follow;
  };

  // InvalidArgument for a camera or options that make no sense.
  static absl::StatusOr<std::unique_ptr<api::Tracker>> Create(Server server, const Camera& camera,
                                                              const LocalTrackerOptions& options, int max_keyframes);

  // Until the server has found the camera once, answers are of its last attempt.
  absl::StatusOr<api::TrackAnswer> Track(const api::TrackFrame& frame) override;

 private:
  RegionTracker(Server server, const Camera& camera, const LocalTrackerOptions& options, int max_keyframes)
      : server_(std::move(server)), camera_(camera), options_(options), max_keyframes_(max_keyframes) {}

  absl::StatusOr<api::TrackAnswer> Begin(const api::TrackFrame& frame);
  // Asks the server where the camera is, if it was not asked lately; true if it knows.
  absl::StatusOr<bool> Ask(const api::TrackFrame& frame, std::string* reason);
  void MoveAlong(const api::TrackAnswer& answer);
  // How far the region reaches around its middle: it is moved on when the camera has come half as far.
  void Measure();

  const Server server_;
  const Camera camera_;
  const LocalTrackerOptions options_;
  const int max_keyframes_;
  FrameTimes times_;  // until there is a tracker

  std::shared_ptr<FollowedMap> copy_;
  std::unique_ptr<LocalTracker> tracker_;
  map::RegionQuery region_;
  std::optional<TimeNs> asked_ns_;
  std::string miss_;                               // of the last time the server was asked
  std::shared_ptr<const tracking::MapView> seen_;  // that was measured
  bool moving_ = false;                            // a region was asked for that is not there yet
  ComponentId component_;                          // of the region
  Vector3d middle_ = Vector3d::Zero();
  double reach_ = 0.0;
};

}  // namespace cairn::client
