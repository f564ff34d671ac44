// What feature_start.cc and feature_start_minima.cc share.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "geometry/se3.h"

namespace cairn::direct {

inline constexpr int kMaxStartViews = 12;  // in the bundle adjustment

// 0 without values.
inline double Median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Between two rays, in rad.
inline double Angle(const Vector3d& a, const Vector3d& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

}  // namespace cairn::direct
