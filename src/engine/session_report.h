// What a session tells at its end.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/sample_reservoir.h"
#include "base/time.h"
#include "direct/odometry.h"
#include "engine/live_poses.h"
#include "engine/whereabouts.h"
#include "map/entities.h"
#include "mapping/component_join.h"
#include "mapping/feature_mapper.h"
#include "mapping/loop_closer.h"

namespace cairn::engine {

// A component of the map, and what this session has in it.
struct ComponentShare {
  ComponentId id;
  std::int64_t keyframes = 0;  // in the map, of all sessions
  std::int64_t frames = 0;     // of this session, with a pose
  TimeNs first_ns = 0, last_ns = 0;
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
  std::optional<mapping::TrajectoryQuality> quality;        // of the trajectory as a whole
  std::vector<mapping::TrajectoryKeyframe> keyframe_poses;  // likewise
};

}  // namespace cairn::engine
