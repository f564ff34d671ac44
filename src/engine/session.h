// One session: a camera stream becomes, or extends, a map. Takes raw images in temporal order, runs the direct odometry
// on each and the feature module on the keyframes that leave it, and commits every change of the map as it happens.
// It maps into a component of its own until overlap with another one is proven, and looks for that all the time;
// several sessions can do so in one map at once.
//
// Owns every thread of the processing: AddFrame() tracks in the caller's thread, the odometry maps in a second one, and
// the feature module works in a third. In deterministic mode there is none but the caller's: the same input gives the
// same output, to the bit.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/sample_reservoir.h"
#include "base/status.h"
#include "base/time.h"
#include "direct/odometry.h"
#include "engine/frame_preparation.h"
#include "engine/live_map.h"
#include "engine/live_poses.h"
#include "engine/session_record.h"
#include "mapping/collinearity.h"
#include "mapping/component_join.h"
#include "mapping/feature_mapper.h"
#include "mapping/loop_closer.h"

namespace cairn::engine {

struct SessionOptions {
  bool deterministic = false;  // as threads = 1, and nothing is recorded that differs from run to run
  // 1: everything in the caller's thread; 2: the feature module in one of its own; 3: the odometry's mapping too. More
  // are not used.
  int threads = 3;
  direct::OdometryOptions odometry;
  mapping::FeatureMapperOptions mapping;
  bool close_loops = true;  // needs a vocabulary
  mapping::LoopOptions loops;
  mapping::JoinOptions joins;
  mapping::CollinearityOptions collinearity;
  int packet_queue_limit = 5;  // keyframes waiting for an older one (paper Sec. V)
  int mapping_backlog = 8;     // packets waiting for the feature module; the odometry then waits for it
  // So many frames without a pose, and the feature module is asked where the camera is in the map (0: never). It looks
  // at one image at a time, the longer the search the more rarely, and only in a map with a vocabulary.
  int seek_after_frames = 2;
  int UsedThreads() const { return deterministic ? 1 : threads; }
  absl::Status Validate() const;
};

// A component of the map, and what this session has in it.
struct ComponentShare {
  ComponentId id;
  std::int64_t keyframes = 0;  // in the map, of all sessions
  std::int64_t frames = 0;     // of this session, with a pose
  TimeNs first_ns = 0, last_ns = 0;
};

// When and where a session was found in what was there before.
struct LocatedAt {
  TimeNs time_ns = 0;     // of the image that was found
  ComponentId component;  // as it was named then
};

struct SessionReport {
  SessionId session;
  std::int64_t frames = 0;
  std::int64_t frames_tracked = 0;
  std::int64_t direct_keyframes = 0;
  std::int64_t keyframes = 0;  // in the map
  std::int64_t points = 0;
  // Those with keyframes; the poses of one say nothing of those of another.
  std::vector<ComponentShare> components;
  ComponentId component;  // in which the session ended
  map::SessionResult result = map::SessionResult::kUnknown;
  std::optional<LocatedAt> located;           // of a session that was found in an earlier component, and proved it
  std::vector<mapping::JoinReport> joins;     // in order
  std::vector<TimeNs> join_times_ns;          // of the keyframes that proved them
  std::map<std::string, int> joins_rejected;  // keyframes found elsewhere that proved nothing, by the reason
  std::int64_t feature_losses = 0;            // times the feature module lost the map
  std::vector<mapping::LoopReport> loops;     // closed, in order
  std::map<std::string, int> loops_rejected;  // searches that ended with a candidate that is no loop, by the reason
  SampleReservoir loop_search_ms;             // per keyframe inserted
  SampleReservoir correction_ms;              // per loop: pose graph and commit
  SampleReservoir adjustment_ms;              // per loop: the bundle adjustment of the map beside the mapping
  SampleReservoir frame_ms;                   // per call of AddFrame
  SampleReservoir frame_ms_correcting;  // of the last 65536 the ones while a loop was corrected or the map adjusted
  SampleReservoir keyframe_ms;          // per packet through the feature module
  std::vector<mapping::KeyframeReport> keyframe_reports;  // what became of each of them
  direct::OdometryStatistics odometry;
  std::optional<mapping::LensReport> lens;  // what the map says of the camera's lens
  map::ReportedTrajectory trajectory;       // which of the two the frame poses below follow, and why
  std::vector<FramePose> frame_poses;
  std::vector<mapping::TrajectoryKeyframe> keyframe_poses;  // likewise
};

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

  // Keyframes that the map holds by now.
  std::int64_t KeyframesInMap() const;

  // Where the session is by now, for those who wait for it: in a component of its own, or found in an earlier one. From
  // any thread.
  struct Whereabouts {
    ComponentId component;  // none before the first keyframe
    std::optional<LocatedAt>
        located;  // as soon as an image was found in a component that was there before, proven or not
    std::optional<TimeNs> joined_ns;  // and proven: of the keyframe that did
  };
  Whereabouts Where() const;

  // The poses of all frames so far in the map as it is now, after every loop and adjustment until now; at the end those
  // of the report. From any thread at any time; nobody who tracks or maps waits for it longer than a copy takes.
  std::vector<FramePose> FramePoses() const;
  // Of one answer of AddFrame(), in the component that the session is in now. None while nothing links it to the map.
  std::optional<LivePose> PoseInMap(const direct::FrameResult& frame) const;

  // Ends the stream, waits for the feature module, closes the session in the map. FailedPrecondition, saying what the
  // odometry waited for, if there never was a map.
  absl::StatusOr<SessionReport> Finish();

 private:
  class Impl;
  explicit Session(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace cairn::engine
