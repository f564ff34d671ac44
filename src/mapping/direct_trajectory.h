// The other of the two trajectories (Lee and Civera, "Loosely-Coupled Semi-Direct Monocular SLAM", RA-L 2019, Sec.
// V-E): the keyframes as the direct module left them, placed in the map.
#pragma once

#include <vector>

#include "mapping/keyframe_trajectory.h"

namespace cairn::mapping {

// The same keyframes with the poses of the direct module. Each segment is placed in the map by the similarity that fits
// it best to `refined`, by the positions and the orientations of its located keyframes. A segment with fewer than three
// of them, or that stayed in one place, keeps its refined poses. FramePose() takes the result like the refined
// trajectory.
std::vector<TrajectoryKeyframe> DirectTrajectory(const std::vector<TrajectoryKeyframe>& refined);

}  // namespace cairn::mapping
