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

namespace cairn::engine {

// The pose of one frame. Frames without a pose were not tracked, or nothing links them to the map (yet).
struct FramePose {
  std::int64_t index = 0;
  TimeNs time_ns = 0;
  direct::TrackingState state = direct::TrackingState::kInitializing;
  std::optional<SE3> map_from_camera;
  ComponentId component;  // in whose frame the pose is; none without a pose
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
};

class LivePoses {
 public:
  // By the thread of the feature module. `refined`: which of the two trajectories is reported (mapping/collinearity.h).
  // O(keyframes), some microseconds per hundred.
  void Publish(std::shared_ptr<const map::Snapshot> map, const mapping::KeyframeTrajectory& trajectory, bool refined);

  // Every frame so far. Keyframes that the feature module has not had yet are placed by the odometry's motion.
  PosesInMap All(const direct::Odometry& odometry) const;
  // One frame that was just tracked, by the odometry's motion since the last keyframe that was found in the map; none
  // while its segment has no such keyframe. O(1). The refined trajectory in any case.
  std::optional<LivePose> Of(const direct::FrameResult& frame) const;

 private:
  struct State {
    std::shared_ptr<const map::Snapshot> map;
    mapping::KeyframeTrajectory trajectory;
    bool refined = true;
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
