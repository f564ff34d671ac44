// The plane in which positions are drawn.
#pragma once

#include <span>
#include <string>

#include "geometry/se3.h"

namespace cairn::plot {

struct Projection {
  // Rows: the directions drawn to the right, up, and towards the viewer; right-handed.
  Matrix3d axes = Matrix3d::Identity();
  Vector3d origin = Vector3d::Zero();
  std::string names[3] = {"x", "y", "z"};

  Vector3d operator()(const Vector3d& point) const { return axes * (point - origin); }
};

// Right and up span the plane of largest extent (principal component analysis): two of the world's axes if its normal
// is within `snap_deg` of the third, else the principal axes with the mean as origin.
Projection PrincipalPlane(std::span<const Vector3d> points, double snap_deg = 15.0);

// From above, along -up. The longest horizontal extent of the points runs to the right, or a world axis if `up` is one.
Projection TopView(std::span<const Vector3d> points, const Vector3d& up);

}  // namespace cairn::plot
