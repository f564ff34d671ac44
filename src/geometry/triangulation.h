// Points from rays of known cameras: linear triangulation (Hartley, Zisserman, "Multiple view geometry", 2nd ed.,
// Sec. 12.2) on normalized rays.
#pragma once

#include <optional>
#include <span>

#include "geometry/se3.h"

namespace cairn {

// The point, in the frame of camera a, that both rays see. Rays are directions in their own camera's frame, of any
// length. Nothing if the rays are parallel to numerical precision, or meet behind a camera.
std::optional<Vector3d> TriangulateTwoView(const SE3& b_from_a, const Vector3d& ray_a, const Vector3d& ray_b);

// The point, in the world, that all rays see; at least two. Nothing as above. The result does not depend on where the
// world's origin lies nor on its unit.
std::optional<Vector3d> TriangulateViews(std::span<const SE3> camera_from_world, std::span<const Vector3d> rays);

// Angle between two directions given in one frame, in [0, pi]; precise for small angles.
double AngleBetweenRad(const Vector3d& a, const Vector3d& b);

// Angle at the point between the lines to two camera centres.
double ParallaxRad(const Vector3d& point, const Vector3d& centre_a, const Vector3d& centre_b);

}  // namespace cairn
