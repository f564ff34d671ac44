// The settings of a session.
#pragma once

#include "base/status.h"
#include "direct/odometry_options.h"
#include "mapping/collinearity.h"
#include "mapping/component_join.h"
#include "mapping/feature_mapper_options.h"
#include "mapping/loop_options.h"
#include "mapping/map_memory.h"

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
  mapping::MapMemoryOptions memory;  // its window is the odometry's
  int packet_queue_limit = 5;        // keyframes waiting for an older one (paper Sec. V)
  int mapping_backlog = 8;           // packets waiting for the feature module; the odometry then waits for it
  // So many frames without a pose, and the feature module is asked where the camera is in the map (0: never). It looks
  // at one image at a time, the longer the search the more rarely, and only in a map with a vocabulary.
  int seek_after_frames = 2;
  int UsedThreads() const { return deterministic ? 1 : threads; }
  mapping::MapMemoryOptions UsedMemory() const { return {odometry.max_keyframes, memory.min_share}; }
  absl::Status Validate() const;
};

}  // namespace cairn::engine
