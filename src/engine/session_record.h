// What the map remembers of a session: its camera, source, software and times.
#pragma once

#include <optional>
#include <string>

#include "base/status.h"
#include "base/time.h"
#include "engine/map_writer.h"
#include "geometry/camera.h"
#include "geometry/pinhole.h"
#include "image/photometric.h"

namespace cairn::engine {

// The stream that a session maps.
struct SessionSource {
  std::string name;
  Camera camera;
  std::optional<image::PhotometricCalibration> photometric;
  TimeNs first_ns = 0;
  std::string settings_json = "{}";
};

// Adds the camera (of images undistorted to `pinhole`) and an open session to the map. `wall_clock`: record the time of
// day, which differs from run to run.
absl::StatusOr<map::Session> BeginSession(const SessionSource& source, const Pinhole& pinhole, bool wall_clock,
                                          MapWriter* writer);
// Marks the session complete. `trajectory`: which one it reported, if it had two.
absl::Status EndSession(SessionId session, TimeNs last_ns, bool wall_clock,
                        std::optional<map::ReportedTrajectory> trajectory, MapWriter* writer);

// A new map's identity: 32 hex digits, random, or derived from `deterministic_seed` if that is given.
std::string NewMapId(const std::optional<std::string>& deterministic_seed);
// Wall clock, nanoseconds since 1970.
std::int64_t UnixNowNs();

}  // namespace cairn::engine
