// When a camera without a pose is looked for in the map: from the second frame on, one image at a time, and the longer
// the search the more rarely.
#pragma once

#include <atomic>

#include "base/time.h"

namespace cairn::engine {

class LostSearch {
 public:
  // `after_frames` without a pose it begins; 0: never.
  explicit LostSearch(int after_frames) : after_frames_(after_frames) {}

  // In the thread that tracks, for each frame.
  void Tracked() { untracked_ = 0; }
  // True if this frame is to be looked for; Answered() must follow.
  bool Untracked(TimeNs time_ns) {
    if (untracked_++ == 0) since_ns_ = next_ns_ = time_ns;
    if (after_frames_ == 0 || untracked_ < after_frames_ || time_ns < next_ns_) return false;
    if (under_way_.exchange(true)) return false;
    next_ns_ = time_ns + FromSeconds(kEvery * ToSeconds(time_ns - since_ns_));
    return true;
  }
  // By whoever looked for it, or gave up.
  void Answered() { under_way_ = false; }

 private:
  static constexpr double kEvery = 0.1;  // searches come this share of the time since the loss apart

  const int after_frames_;
  int untracked_ = 0;  // frames since the last with a pose
  TimeNs since_ns_ = 0;
  TimeNs next_ns_ = 0;
  std::atomic<bool> under_way_ = false;
};

}  // namespace cairn::engine
