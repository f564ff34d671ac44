// The times of a stream of images have to increase; a clock that is set, or a broken driver, must not reach those who
// divide by the time between two. Used wherever frames come in.
#pragma once

#include <optional>

#include "base/status.h"
#include "base/time.h"

namespace cairn {

// Differences of two such times fit into 64 bits. 4e9 s: from 1970 until 2096, and as long before.
inline constexpr TimeNs kMaxTimeNs = 4'000'000'000'000'000'000;

class FrameTimes {
 public:
  // A leap further ahead than this is believed when the next frame comes after it, within as much: a recording may be
  // taken up days later, but one broken time must not make all that follow it look old.
  static constexpr TimeNs kLeapNs = 86'400'000'000'000;  // one day

  // OK if a frame of this time may follow the last accepted one: it is that now. InvalidArgument otherwise, which says
  // why; the frame should be left out and counted, and the stream go on.
  absl::Status Accept(TimeNs time_ns);

 private:
  std::optional<TimeNs> last_ns_;
  std::optional<TimeNs> doubted_ns_;  // of the frame before, if it was a leap
};

}  // namespace cairn
