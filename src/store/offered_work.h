// Work of one thread that another one may share in when it has nothing better to do.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <utility>

namespace cairn::store {

class OfferedWork {
 public:
  // Calls `mine`; whoever waits in Help() calls `theirs` meanwhile. Returns when both have returned.
  void Share(const std::function<void()>& mine, std::function<void()> theirs) {
    {
      const std::lock_guard lock(mutex_);
      offered_ = std::move(theirs);
    }
    changed_.notify_all();
    mine();
    std::unique_lock lock(mutex_);
    offered_ = nullptr;
    changed_.wait(lock, [this] { return !helping_; });
  }
  // There is no more: Help() returns.
  void End() {
    {
      const std::lock_guard lock(mutex_);
      ended_ = true;
    }
    changed_.notify_all();
  }
  // In another thread, until End(). What is called must not throw.
  void Help() {
    std::unique_lock lock(mutex_);
    while (true) {
      changed_.wait(lock, [this] { return ended_ || offered_; });
      if (!offered_) return;
      const std::function<void()> work = std::exchange(offered_, nullptr);
      helping_ = true;
      lock.unlock();
      work();
      lock.lock();
      helping_ = false;
      changed_.notify_all();
    }
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::function<void()> offered_;  // nobody has begun with it
  bool helping_ = false;
  bool ended_ = false;
};

}  // namespace cairn::store
