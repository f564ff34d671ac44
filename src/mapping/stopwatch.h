// Wall time of the stages of mapping.
#pragma once

#include <chrono>

namespace cairn::mapping {

class Stopwatch {
 public:
  // Milliseconds since the start or the last call.
  double LapMs() {
    const auto now = std::chrono::steady_clock::now();
    const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
    last_ = now;
    return ms;
  }

 private:
  std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace cairn::mapping
