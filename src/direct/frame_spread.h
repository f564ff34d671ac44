// The poses of the frames between keyframes, after the window has been optimized.
#pragma once

#include <vector>

#include "direct/odometry.h"

namespace cairn::direct {

// Makes the pose of a frame relative to the newest keyframe that is not newer than the frame, and gives it its share
// (by time) of what optimization has changed of the motion from there to the next keyframe. A frame that was tracked
// against an older keyframe, because the newer one was not ready, goes over to the newer one by what tracking made of
// both. `keyframes` are all, by their numbers.
void SpreadCorrection(const std::vector<KeyframePose>& keyframes, FrameResult* frame);

}  // namespace cairn::direct
