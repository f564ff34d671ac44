// A mutex whose waiters get it in the order in which they came: who lets go of it and wants it again at once is behind
// those who wait. For work in large pieces, by threads that must not starve each other.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <mutex>

namespace cairn {

// Lockable as std::mutex is, without try_lock().
class FairMutex {
 public:
  void lock() {
    std::unique_lock lock(mutex_);
    const std::uint64_t ticket = next_ticket_++;
    turn_.wait(lock, [&] { return now_serving_ == ticket; });
  }
  void unlock() {
    const std::lock_guard lock(mutex_);
    ++now_serving_;
    turn_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable turn_;
  std::uint64_t next_ticket_ = 0;
  std::uint64_t now_serving_ = 0;
};

}  // namespace cairn
