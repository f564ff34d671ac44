// One session: a camera stream becomes, or extends, a map. Takes raw images in temporal order, runs the direct odometry
// on each and the feature module on the keyframes that leave it, and commits every change of the map as it happens.
// It maps into a component of its own until overlap with another one is proven, and looks for that all the time;
// several sessions can do so in one map at once.
//
// Owns every thread of the processing: AddFrame() tracks in the caller's thread, the odometry maps in a second one, and
// the feature module works in a third. In deterministic mode there is none but the caller's: the same input gives the
// same output, to the bit.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "base/status.h"
#include "direct/packet.h"
#include "engine/frame_preparation.h"
#include "engine/live_map.h"
#include "engine/live_poses.h"
#include "engine/odometry_session.h"
#include "engine/session_options.h"
#include "engine/session_record.h"
#include "engine/session_report.h"
#include "engine/whereabouts.h"

namespace cairn::engine {

class Session {
 public:
  // `map` must outlive the session. InvalidArgument also for a camera that contradicts one of the map
  // (session_record.h).
  static absl::StatusOr<std::unique_ptr<Session>> Create(const SessionOptions& options, const SessionSource& source,
                                                         LiveMap* map);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;

  // The live answer. InvalidArgument for an image that does not fit the camera: the frame is skipped, the session goes
  // on. Any other error (the map could not be written) ends it.
  absl::StatusOr<direct::FrameResult> AddFrame(const RawFrame& frame);
  // The same, with preparation() done before: by a FrameFeed, which does it ahead.
  absl::StatusOr<direct::FrameResult> AddFrame(const direct::Frame& frame);
  const FramePreparation& preparation() const;

  SessionId id() const;  // in the map

  // Keyframes that the map holds by now.
  std::int64_t KeyframesInMap() const;

  // Where the session is by now, for those who wait for it. From any thread.
  Whereabouts Where() const;

  // The poses of all frames so far in the map as it is now, after every loop and adjustment until now; at the end those
  // of the report. From any thread at any time; nobody who tracks or maps waits for it longer than a copy takes.
  std::vector<FramePose> FramePoses() const;
  // Of one answer of AddFrame(), in the component that the session is in now. None while nothing links it to the map.
  std::optional<LivePose> PoseInMap(const direct::FrameResult& frame) const;

  // Ends the stream, waits for the feature module, closes the session in the map. FailedPrecondition, saying which
  // stage waited for what, if there never was a map.
  absl::StatusOr<SessionReport> Finish();

  // The poses of the odometry by itself, after Finish(): all that there is if it made no map. FailedPrecondition if
  // there are none.
  absl::StatusOr<OdometryReport> FinalOdometry() const;

 private:
  class Impl;
  explicit Session(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace cairn::engine
