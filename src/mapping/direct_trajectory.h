// What the direct module makes of its keyframes, for the map: the other of the two trajectories (Lee and Civera,
// "Loosely-Coupled Semi-Direct Monocular SLAM", RA-L 2019, Sec. V-E; map_memory.h chooses), and rotations.
#pragma once

#include <span>
#include <vector>

#include "mapping/keyframe_trajectory.h"
#include "mapping/local_adjustment.h"
#include "mapping/map_memory.h"

namespace cairn::mapping {

// The same keyframes with the direct module's poses in the stretches given. One that is all of its segment is placed by
// the similarity that fits it best to `refined`, by positions and orientations. One at an end of its segment hangs on
// the refined keyframe beside it, in the unit of that similarity; one between two hangs on both, in the unit that the
// refined keyframes on both sides of it agree on, and the difference is spread evenly over time. Stretches with fewer
// than three located keyframes, or that stay in one place, keep their refined poses. PoseOfFrame() takes the result
// like the refined trajectory.
std::vector<TrajectoryKeyframe> WithDirectStretches(const std::vector<TrajectoryKeyframe>& refined,
                                                    std::span<const Stretch> stretches);

// Between the keyframes of `map` that follow each other within a segment, in temporal order. Direct odometry measures
// rotation from image to image more precisely than features do, if not over a long way.
std::vector<KeyframeRotation> DirectRotations(const std::vector<KeyframeTrajectory::Entry>& entries,
                                              const map::Snapshot& map);

}  // namespace cairn::mapping
