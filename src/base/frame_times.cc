#include "base/frame_times.h"

#include "absl/strings/str_format.h"

namespace cairn {
namespace {

std::string Text(TimeNs time_ns) { return absl::StrFormat("%.6f s", ToSeconds(time_ns)); }

}  // namespace

absl::Status FrameTimes::Accept(TimeNs time_ns) {
  if (time_ns > kMaxTimeNs || time_ns < -kMaxTimeNs) {
    return absl::InvalidArgumentError(
        absl::StrCat("the frame's time, ", Text(time_ns), ", is out of range; is the unit right?"));
  }
  if (last_ns_ && time_ns <= *last_ns_) {
    doubted_ns_.reset();
    return absl::InvalidArgumentError(absl::StrCat("the frame's time, ", Text(time_ns), ", is not after that of the ",
                                                   "frame before, ", Text(*last_ns_)));
  }
  if (last_ns_ && time_ns - *last_ns_ > kLeapNs) {
    const bool confirmed = doubted_ns_ && time_ns > *doubted_ns_ && time_ns - *doubted_ns_ <= kLeapNs;
    if (!confirmed) {
      doubted_ns_ = time_ns;
      return absl::InvalidArgumentError(absl::StrCat("the frame's time, ", Text(time_ns), ", is more than a day after ",
                                                     "that of the frame before, ", Text(*last_ns_)));
    }
  }
  doubted_ns_.reset();
  last_ns_ = time_ns;
  return absl::OkStatus();
}

}  // namespace cairn
