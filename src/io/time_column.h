// The times of a list or a trajectory, and their unit, which files rarely say: it is cross-checked between the header,
// the size of the numbers (since 1970 or not), the step from one to the next, and the rate of the camera. What the file
// of its format usually holds is taken in silence; another unit is told; what could be two units is refused.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "base/time.h"
#include "io/time_text.h"

namespace cairn::io {

struct TimeText {
  int line = 0;  // for messages
  absl::string_view text;
};

struct TimeColumnRules {
  TimeUnit usual = TimeUnit::kSeconds;           // in files of this format
  std::optional<TimeUnit> named;                 // by the file itself
  double rate_hz = 0.0;                          // of the camera file; 0: not said
  bool of_images = true;                         // false: of poses, of which there may be few
  std::string example = "# time [ms] filename";  // a first line that would name the unit
};

struct TimeColumn {
  TimeUnit unit = TimeUnit::kSeconds;
  std::vector<TimeNs> times_ns;  // as many as there were texts
  bool counts = false;           // whole numbers one apart, taken for seconds: they may count frames
  std::string note;              // for people; empty: all is as usual
};

// InvalidArgument names file, line and remedy. The order of the times is not looked at.
absl::StatusOr<TimeColumn> ReadTimeColumn(const std::string& path, const std::vector<TimeText>& texts,
                                          const TimeColumnRules& rules);

// The unit that the name of a column tells: "timestamp [ns]", "time_ms", "seconds", "frame".
std::optional<TimeUnit> UnitOfColumn(absl::string_view name);

// Whether a column of this name holds times.
bool NamesTime(absl::string_view name);

}  // namespace cairn::io
