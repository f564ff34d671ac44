// The settings of client::LocalTracker, with defaults for every map and camera.
#pragma once

#include <optional>

#include "base/status.h"
#include "client/anchor.h"
#include "client/map_matcher.h"
#include "direct/odometry_options.h"
#include "image/photometric.h"

namespace cairn::client {

enum class TrackMode {
  kSemiDirect,  // direct tracking for every frame, ORB beside it
  kFeatures,    // ORB for every frame
};

struct LocalTrackerOptions {
  TrackMode mode = TrackMode::kSemiDirect;
  direct::OdometryOptions odometry;
  MapMatcherOptions matching;
  DriftOptions drift;
  // Response and vignette of the camera: the odometry sees images without them.
  std::optional<image::PhotometricCalibration> photometric;
  // Everything in the caller's thread and in one order: the same images give the same answers. Calls that match the map
  // or optimize the odometry's window take as long as that.
  bool deterministic = false;
  // A frame without a pose is looked for in the whole map where Track() is called, which takes as long as a
  // relocalization (and a miss longer). False: beside it; the answer reaches a later frame, and no call takes long.
  bool relocalize_in_call = true;
  // For recordings that are read faster than they were made: a call waits for the match of the frame before, if there
  // is one, so that as many are matched as of a live camera, and their answers come as soon.
  bool wait_for_matches = false;
  double match_interval_s = 0.2;     // between frames that are matched against the map, by their times
  double max_match_age_s = 1.0;      // a pose that was carried on for longer counts as carried, not as tracked
  double refresh_interval_s = 0.25;  // between looks at the file for a newer revision, by the wall clock

  absl::Status Validate() const;
};

}  // namespace cairn::client
