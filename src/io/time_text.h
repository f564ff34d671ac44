// Times as decimal text, exact to the nanosecond: a double would lose digits on epoch times.
#pragma once

#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "base/time.h"

namespace cairn::io {

// "1403715273.262142976", "33.3", "1.036000e-01": seconds to nanoseconds, digits beyond the ninth rounded half away
// from zero.
absl::StatusOr<TimeNs> ParseSeconds(absl::string_view text);

// "1403715273262142976": whole nanoseconds.
absl::StatusOr<TimeNs> ParseNanoseconds(absl::string_view text);

// Seconds with nine decimals.
std::string FormatSeconds(TimeNs time_ns);

}  // namespace cairn::io
