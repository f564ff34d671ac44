// Times of the stages of mapping.
#pragma once

#include <chrono>
#include <ctime>

namespace cairn::mapping {

// Wall time.
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

// Processor time of the calling thread: what a stage costs, however busy the machine is.
class CpuStopwatch {
 public:
  double LapMs() {
    const double now = NowMs();
    const double ms = now - last_;
    last_ = now;
    return ms;
  }

 private:
  static double NowMs() {
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
  }
  double last_ = NowMs();
};

}  // namespace cairn::mapping
