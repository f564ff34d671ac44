// What the ways of `cairn run` share. Each way is a file of its own: run_map.cc (a sequence into a map), run_stills.cc
// (stills with known poses), run_odometry.cc (poses only), run_served.cc (a sequence into a map of a server).
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "base/status.h"
#include "cli/cli.h"
#include "cli/input_options.h"
#include "cli/interrupt.h"
#include "cli/run_feed.h"
#include "cli/server_option.h"
#include "engine/live_map.h"
#include "engine/odometry_session.h"
#include "engine/session.h"
#include "io/frame_source.h"
#include "mapping/posed_mapper.h"
#include "place/vocabulary.h"

namespace cairn::cli {

struct RunOptions {
  InputOptions input;
  ServerChoice server;  // empty: `map` is a file
  std::string map;
  bool extend = false;
  std::string name;
  std::string camera_name;
  std::string trajectory;
  std::string quality;
  std::string live_poses;
  std::string keyframes;
  std::string poses;
  std::string vocabulary;
  std::string picture;
  engine::SessionOptions session;
  mapping::PosedMapperOptions posed;
  bool odometry_only = false;
  std::string preset = "default";
  bool full_resolution = false;
  int threads = 0;              // 0: as many as are of use
  double realtime_speed = 0.0;  // 0: as fast as possible
  bool overwrite = false;
  bool json = false;
};

absl::Status MapSequence(const RunOptions& options, InterruptWatch* interrupt);
absl::Status MapServed(const RunOptions& options, InterruptWatch* interrupt);
absl::Status MapStills(const RunOptions& options, InterruptWatch* interrupt);
absl::Status TrackSequence(const RunOptions& options, InterruptWatch* interrupt);

// How the frames come to a session.
FeedSettings ToFeedSettings(const RunOptions& options, std::string progress);
absl::StatusOr<std::unique_ptr<io::FrameSource>> OpenRunInput(const RunOptions& options);

// Everything that a run into a map needs besides the session.
struct MapRun {
  std::unique_ptr<io::FrameSource> source;
  std::unique_ptr<engine::LiveMap> map;
  engine::SessionSource session_source;
};
absl::StatusOr<MapRun> PrepareMapRun(const RunOptions& options);

// How sure each pose of a trajectory is, as a CSV file beside it (docs/input.md).
absl::Status WriteQuality(const RunOptions& options, const engine::SessionReport& report, const map::Snapshot& map);

// The files that a run into a map leaves beside it: poses in `component`, or in the world if that is aligned.
absl::Status WriteMapOutputs(const RunOptions& options, const map::Snapshot& map, ComponentId component,
                             const std::vector<std::pair<TimeNs, SE3>>& frame_poses);
// Of the odometry alone. Poses of different segments have no common frame: the files hold the longest one.
absl::Status WriteOdometryPoses(const RunOptions& options, const engine::OdometryReport& report);
// Of all keyframes of a component, map_from_camera in temporal order.
std::vector<std::pair<TimeNs, SE3>> MapKeyframePoses(const map::Snapshot& map, ComponentId component);

}  // namespace cairn::cli
