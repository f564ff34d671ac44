// What the map remembers of a session: its camera, source, software and times.
#pragma once

#include <optional>
#include <string>

#include "base/status.h"
#include "base/time.h"
#include "geometry/camera.h"
#include "geometry/pinhole.h"
#include "image/photometric.h"
#include "map/edit.h"
#include "mapping/map_head.h"

namespace cairn::engine {

// The stream that a session maps.
struct SessionSource {
  std::string name;         // of the sequence
  std::string camera_name;  // empty: it is named after its calibration
  Camera camera;
  std::optional<image::PhotometricCalibration> photometric;
  TimeNs first_ns = 0;
  std::string settings_json = "{}";
};

// The camera of the map with this calibration, or a new one for images undistorted to `pinhole`: the same camera is one,
// however often it comes. InvalidArgument if the map has another calibration under the same name (`name` may be empty),
// with both.
absl::StatusOr<CameraId> FindOrAddCamera(const std::string& name, const Camera& camera, const Pinhole& pinhole,
                                         map::Edit* edit);

// Adds the camera if it is new, and an open session. `wall_clock`: record the time of day, which differs from run to
// run.
absl::StatusOr<map::Session> BeginSession(const SessionSource& source, const Pinhole& pinhole, bool wall_clock,
                                          mapping::MapHead& head);
// Marks the session complete. `trajectory`: which one it reported, if it had two.
absl::Status EndSession(SessionId session, TimeNs last_ns, bool wall_clock,
                        std::optional<map::ReportedTrajectory> trajectory, mapping::MapHead& head);
// How a session that ends has come out: it made the map, was found in what others had made, or stayed apart.
map::SessionResult ResultOf(const map::Snapshot& map, SessionId session);

// A new map's identity: 32 hex digits, random, or derived from `deterministic_seed` if that is given.
std::string NewMapId(const std::optional<std::string>& deterministic_seed);
// Wall clock, nanoseconds since 1970.
std::int64_t UnixNowNs();

}  // namespace cairn::engine
