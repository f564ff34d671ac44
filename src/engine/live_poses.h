// The poses of frames in the map as it is now, at any time of a session and from any thread. The feature module
// publishes what it knows of its keyframes after each of its changes, loops and adjustments included; an answer works
// on that and on a copy of the odometry's history, so nobody who tracks or maps waits for it.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <vector>

#include "base/time.h"
#include "direct/odometry.h"
#include "map/snapshot.h"
#include "mapping/keyframe_trajectory.h"
#include "mapping/map_memory.h"
#include "mapping/trajectory_quality.h"

namespace cairn::engine {

// The pose of one frame. Frames without a pose were not tracked, or nothing links them to the map (yet).
struct FramePose {
  std::int64_t index = 0;
  TimeNs time_ns = 0;
  direct::TrackingState state = direct::TrackingState::kInitializing;
  std::optional<SE3> map_from_camera;
  ComponentId component;  // in whose frame the pose is; none without a pose
  // 0 to 1: of the tracking of the frame (direct::FrameResult::quality), at the end of a session no more than that of
  // the trajectory (mapping/trajectory_quality.h). Below mapping::kQualityLimit it is not to be relied on.
  double quality = 0.0;
  mapping::KeyframeSigma sigma;  // at the end of a session
};

// Of a frame that was just tracked, as far as was known then.
struct LivePose {
  ComponentId component;
  SE3 map_from_camera;                       // frame and unit of that component ...
  std::optional<Sim3> world_from_component;  // ... which lies there in the world, if it is aligned

  // In metres if aligned.
  SE3 WorldFromCamera() const {
    return world_from_component ? world_from_component->TransformPose(map_from_camera) : map_from_camera;
  }
};

// Frames against the keyframes that they hang on, both in temporal order.
struct PosesInMap {
  std::vector<FramePose> frames;
  std::vector<mapping::TrajectoryKeyframe> keyframes;
  std::optional<mapping::TrajectoryQuality> quality;
};

class LivePoses {
 public:
  // By the thread of the feature module. `memory`: by which the odometry's trajectory is reported in parts
  // (mapping/map_memory.h); none: nowhere. O(keyframes), some microseconds per hundred.
  void Publish(std::shared_ptr<const map::Snapshot> map, const mapping::KeyframeTrajectory& trajectory,
               std::optional<mapping::MapMemoryOptions> memory);

  // Every frame so far. Keyframes that the feature module has not had yet are placed by the odometry's motion.
  // `assess`: also how sure they are, which takes longer.
  PosesInMap All(const direct::Odometry& odometry, bool assess = false) const;
  // One frame that was just tracked, by the odometry's motion since the last keyframe that was found in the map; none
  // while its segment has no such keyframe. O(1). The refined trajectory in any case.
  std::optional<LivePose> Of(const direct::FrameResult& frame) const;

 private:
  struct State {
    std::shared_ptr<const map::Snapshot> map;
    mapping::KeyframeTrajectory trajectory;
    std::optional<mapping::MapMemoryOptions> memory;
    // The last keyframe that was found in the map.
    std::int64_t segment = -1;
    ComponentId component;
    SE3 map_from_camera;
    SE3 direct_from_camera;
    double map_per_direct = 1.0;
  };
  std::shared_ptr<const State> Current() const;

  mutable std::mutex mutex_;  // held for the exchange of a pointer only
  std::shared_ptr<const State> state_;
};

}  // namespace cairn::engine
