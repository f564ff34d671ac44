#include "direct/retained_frames.h"

#include <limits>

namespace cairn::direct {

void RetainedFrames::Thin() {
  while (reference_ > max_before_reference_) {
    std::size_t goes = 1;
    TimeNs closest = std::numeric_limits<TimeNs>::max();
    for (std::size_t i = 1; i < reference_; ++i) {
      const TimeNs between = start_[i + 1].frame.time_ns - start_[i - 1].frame.time_ns;
      if (between < closest) closest = between, goes = i;
    }
    start_.erase(start_.begin() + static_cast<std::ptrdiff_t>(goes));
    --reference_;
  }
}

void RetainedFrames::ClearStart() {
  start_.clear();
  reference_ = 0;
}

}  // namespace cairn::direct
