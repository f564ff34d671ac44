// Spreading over the poses between two known ones what is found out at the far one.
#pragma once

#include "geometry/se3.h"

namespace cairn {

// From `from` (share 0) to `to` (share 1): the rotation along the shortest arc, the translation along a line.
SE3 Between(const SE3& from, const SE3& to, double share);

// A chain of poses a_from_camera ended at `predicted` and turns out to end at `actual`: `pose`, a part `share` (0 to 1)
// of the way along, takes that part of the difference, in the axes of a. Share 0 leaves it as it is; the end itself,
// with share 1, becomes `actual`.
SE3 SpreadDifference(const SE3& pose, const SE3& predicted, const SE3& actual, double share);

}  // namespace cairn
