// Times as decimal text, exact to the nanosecond: a double would lose digits on epoch times.
#pragma once

#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "base/time.h"

namespace cairn::io {

enum class TimeUnit { kSeconds, kMilliseconds, kMicroseconds, kNanoseconds, kFrames };

// "seconds", "milliseconds", "microseconds", "nanoseconds", "frame numbers".
absl::string_view TimeUnitName(TimeUnit unit);

// "1403715273.262142976", "33.3", "1.036000e-01" in a unit, which is not kFrames, to nanoseconds; what is less than one
// is rounded half away from zero.
absl::StatusOr<TimeNs> ParseTime(absl::string_view text, TimeUnit unit);
inline absl::StatusOr<TimeNs> ParseSeconds(absl::string_view text) { return ParseTime(text, TimeUnit::kSeconds); }

// "1403715273262142976": whole nanoseconds.
absl::StatusOr<TimeNs> ParseNanoseconds(absl::string_view text);

// Seconds with nine decimals.
std::string FormatSeconds(TimeNs time_ns);

}  // namespace cairn::io
