// The pose of a camera that sees three known points in known directions.
//
// Lengths along the three rays solve three quadratic equations; a degenerate conic of their pencil splits into two
// planes, which leave a quadratic equation each: Persson and Nordberg, "Lambda Twist: An accurate fast robust
// perspective three point (P3P) solver", ECCV 2018. Up to four poses put all three points in front of the camera.
#pragma once

#include <array>

#include "geometry/se3.h"

namespace cairn {

using P3PRays = std::array<Vector3d, 3>;    // unit, camera frame
using P3PPoints = std::array<Vector3d, 3>;  // world frame, in the order of the rays
using P3PPoses = std::array<SE3, 4>;        // camera_from_world

// How many poses there are; the first so many of `poses` are set. 0 where the points are collinear, two rays are the
// same, or no pose fits. Allocates nothing.
int SolveP3P(const P3PRays& rays, const P3PPoints& points, P3PPoses* poses);

}  // namespace cairn
