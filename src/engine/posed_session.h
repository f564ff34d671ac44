// A session over still images whose poses are known: they become a map without odometry.
#pragma once

#include <memory>

#include "base/status.h"
#include "engine/session.h"
#include "engine/session_head.h"
#include "engine/session_record.h"
#include "image/undistort.h"
#include "mapping/posed_mapper.h"

namespace cairn::engine {

class PosedSession {
 public:
  // As Session::Create.
  static absl::StatusOr<std::unique_ptr<PosedSession>> Create(const mapping::PosedMapperOptions& options,
                                                              bool deterministic, const SessionSource& source,
                                                              LiveMap* map);

  // InvalidArgument for an image that does not fit the camera: it is left out, the session goes on.
  absl::Status AddFrame(const RawFrame& frame, const SE3& world_from_camera);

  // Matches, triangulates, adjusts, commits, and closes the session in the map.
  absl::StatusOr<mapping::PosedMapperReport> Finish();
  // That it has mapped into, after Finish().
  ComponentId component() const { return component_; }

 private:
  PosedSession(image::Undistorter undistorter, bool deterministic, LiveMap* map)
      : undistorter_(std::move(undistorter)), deterministic_(deterministic), head_(map) {}

  const image::Undistorter undistorter_;
  const bool deterministic_;
  SessionHead head_;
  map::Session session_;
  TimeNs last_time_ns_ = 0;
  ComponentId component_;
  std::unique_ptr<mapping::PosedMapper> mapper_;
};

}  // namespace cairn::engine
