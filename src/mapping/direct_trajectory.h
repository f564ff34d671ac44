// What the direct module makes of its keyframes, for the map: the other of the two trajectories (Lee and Civera,
// "Loosely-Coupled Semi-Direct Monocular SLAM", RA-L 2019, Sec. V-E), and rotations.
#pragma once

#include <vector>

#include "mapping/keyframe_trajectory.h"
#include "mapping/local_adjustment.h"

namespace cairn::mapping {

// The same keyframes with the poses of the direct module. Each segment is placed in the map by the similarity that fits
// it best to `refined`, by the positions and the orientations of its located keyframes. A segment with fewer than three
// of them, or that stayed in one place, keeps its refined poses. PoseOfFrame() takes the result like the refined
// trajectory.
std::vector<TrajectoryKeyframe> DirectTrajectory(const std::vector<TrajectoryKeyframe>& refined);

// Between the keyframes of `map` that follow each other within a segment, in temporal order. Direct odometry measures
// rotation from image to image more precisely than features do, if not over a long way.
std::vector<KeyframeRotation> DirectRotations(const std::vector<KeyframeTrajectory::Entry>& entries,
                                              const map::Snapshot& map);

}  // namespace cairn::mapping
