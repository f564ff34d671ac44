// How many do heavy work at the same time: no more than the machine has processors for. Who comes first goes first, and
// who would have to wait behind too many is refused at once.
#pragma once

#include <algorithm>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <utility>

#include "base/status.h"

namespace cairn::host {

class WorkGate {
 public:
  WorkGate(int places, int max_waiting) : places_(places), max_waiting_(max_waiting) {}

  // One place, until it is destroyed.
  class Pass {
   public:
    explicit Pass(WorkGate* gate) : gate_(gate) {}
    Pass(Pass&& other) noexcept : gate_(std::exchange(other.gate_, nullptr)) {}
    Pass& operator=(Pass&&) = delete;
    ~Pass() {
      if (gate_ != nullptr) gate_->Leave();
    }

   private:
    WorkGate* gate_;
  };

  // Waits for its turn. ResourceExhausted if `max_waiting` do so already.
  absl::StatusOr<Pass> Enter() {
    std::unique_lock lock(mutex_);
    if (next_ - left_ >= places_ + max_waiting_) {
      return absl::ResourceExhaustedError(
          absl::StrCat(max_waiting_, " others wait for their turn already: ask again later"));
    }
    const std::int64_t turn = next_++;
    changed_.wait(lock, [&] { return turn < left_ + places_; });
    return Pass(this);
  }

  std::int64_t waiting() const {
    const std::lock_guard lock(mutex_);
    return std::max<std::int64_t>(0, next_ - left_ - places_);
  }

 private:
  void Leave() {
    const std::lock_guard lock(mutex_);
    ++left_;
    changed_.notify_all();
  }

  const int places_;
  const int max_waiting_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::int64_t next_ = 0;  // turns given out
  std::int64_t left_ = 0;  // who have left
};

}  // namespace cairn::host
