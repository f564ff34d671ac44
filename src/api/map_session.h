// A session, as its client sees it: a camera stream makes a map, or extends one, in this process or at a daemon.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "base/time.h"
#include "geometry/camera.h"
#include "geometry/se3.h"
#include "map/entities.h"

namespace cairn::api {

struct SessionRequest {
  std::string map;
  map::SessionPolicy policy = map::SessionPolicy::kExtend;
  Camera camera;                // of the raw frames; one that the map knows is recognized by its calibration
  std::string camera_name;      // in the map; empty: after its calibration
  std::string source;           // name of the sequence or the robot, for the history
  std::string title;            // of a new map; empty: `source`
  TimeNs first_ns = 0;          // time of the first frame, as far as it is known
  std::string map_id;           // kExtend: only if the map is this one (MapSession::map_id()); empty: whichever it is
  Revision least_revision = 0;  // kExtend: only if the map is at this one, or a later
  // Who asks, as a server found out, whose sessions are counted together; not sent by clients, empty: not counted.
  std::string client;
};

struct SessionFrame {
  cv::Mat image;                     // CV_8UC1, raw as the camera gives it
  TimeNs time_ns = 0;                // later than the frame's before
  std::uint32_t dropped_before = 0;  // frames that the camera gave since the one before and nobody could take
};

enum class SessionState { kInitializing, kGood, kPoor, kLost };
const char* SessionStateName(SessionState state);

// What is known of a frame right after it came.
struct SessionAnswer {
  TimeNs time_ns = 0;
  SessionState state = SessionState::kInitializing;
  std::string reason;  // without a pose, for people
  // None while nothing links the frame to the map (yet).
  std::optional<SE3> map_from_camera;  // in the frame and unit of `component`
  ComponentId component;
  std::optional<Sim3> world_from_component;  // none: not aligned
};

// Where a session is by now.
struct SessionProgress {
  SessionId session;
  Revision revision = 0;             // the newest that is durable
  std::int64_t keyframes = 0;        // in the map, of all sessions
  std::optional<TimeNs> durable_ns;  // of its last keyframe that is durable: what came before is there for good
  ComponentId component;             // that it maps into; none before the first keyframe
  std::optional<TimeNs> located_ns;  // an image was found in what was there before, proven or not ...
  ComponentId located_component;     // ... in this, as it was named then
  std::optional<TimeNs> joined_ns;   // and proven, by the keyframe of this time
  bool operator==(const SessionProgress&) const = default;
};

struct SessionSummary {
  SessionId session;
  std::int64_t frames = 0;
  std::int64_t frames_tracked = 0;
  std::int64_t keyframes = 0;  // in the map, of all sessions
  std::int64_t points = 0;
  map::SessionResult result = map::SessionResult::kUnknown;
  int joins = 0;
  int loops = 0;
  Revision revision = 0;
  ComponentId component;  // of the poses
  std::optional<Sim3> world_from_component;
  struct Pose {
    TimeNs time_ns = 0;
    SE3 map_from_camera;
  };
  std::vector<Pose> poses;  // of all frames with one in `component`, after the last adjustment
};

// Not for several threads at once. To let go of one without Finish() ends nothing: for a while it can be resumed.
class MapSession {
 public:
  virtual ~MapSession() = default;

  // By which it can be resumed.
  virtual const std::string& token() const = 0;
  // Into which it maps.
  virtual const std::string& map() const = 0;
  // MapInfo::id of that map: a name may be given to another one.
  virtual const std::string& map_id() const = 0;
  // Of its frames.
  virtual const Camera& camera() const = 0;
  // To the last frame that was received, of a session that was resumed; none if there was none.
  virtual const std::optional<SessionAnswer>& last_answer() const = 0;

  // Waits while the session is busy. InvalidArgument for a frame that cannot be used (bad image, time that does not
  // grow): it is skipped, the session goes on. Any other error ends it (the map could not be written, no server).
  virtual absl::StatusOr<SessionAnswer> AddFrame(const SessionFrame& frame) = 0;

  // As of the last frame.
  virtual const SessionProgress& progress() const = 0;

  // Ends the stream: what is under way is mapped, adjusted and stored. FailedPrecondition, saying what the odometry
  // waited for, if nothing was ever mapped.
  virtual absl::StatusOr<SessionSummary> Finish() = 0;
};

}  // namespace cairn::api
