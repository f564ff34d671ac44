// What feature_start.cc and feature_start_minima.cc share.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "base/median.h"
#include "geometry/se3.h"

namespace cairn::direct {

inline constexpr int kMaxStartViews = 12;  // in the bundle adjustment

// Between two rays, in rad.
inline double Angle(const Vector3d& a, const Vector3d& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

}  // namespace cairn::direct
