// Time is int64 nanoseconds, on the clock of the data (camera time), everywhere.
#pragma once

#include <cmath>
#include <cstdint>

namespace cairn {

using TimeNs = std::int64_t;

inline constexpr double kSecondsPerNs = 1e-9;

inline double ToSeconds(TimeNs time_ns) { return static_cast<double>(time_ns) * kSecondsPerNs; }
inline TimeNs FromSeconds(double seconds) { return static_cast<TimeNs>(std::llround(seconds * 1e9)); }

// Seconds with nine decimals, exact (a double would lose digits on epoch times).
// Parsing is in io/trajectory.h.

}  // namespace cairn
