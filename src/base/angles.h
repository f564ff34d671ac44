// Units of angles: radians inside, degrees for people.
#pragma once

#include <numbers>

namespace cairn {

inline constexpr double kDegPerRad = 180.0 / std::numbers::pi;

}  // namespace cairn
