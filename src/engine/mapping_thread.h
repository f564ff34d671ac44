// The feature module's thread: takes jobs from a bounded queue, one after the other, and between them does what can
// wait. Without a thread jobs are done at once, in the caller's. The first error stays, and ends it all: what is queued
// behind it is dropped, so that nobody who waits for room is ever stuck.
#pragma once

#include <functional>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "base/bounded_queue.h"
#include "base/guarded.h"
#include "base/status.h"

namespace cairn::engine {

template <class Job>
class MappingThread {
 public:
  using Handler = std::function<absl::Status(const Job&)>;
  // Called after a job while no other waits, and again for as long as it says that there is more.
  using Meanwhile = std::function<absl::StatusOr<bool>()>;

  MappingThread(std::size_t limit, Handler handle, Meanwhile meanwhile)
      : handle_(std::move(handle)), meanwhile_(std::move(meanwhile)), queue_(limit) {}
  ~MappingThread() { Abandon(); }
  MappingThread(const MappingThread&) = delete;
  MappingThread& operator=(const MappingThread&) = delete;

  // From now on jobs are done by a thread. ResourceExhausted if none can be had.
  absl::Status Start() {
    CAIRN_ASSIGN_OR_RETURN(
        thread_, StartThread(
                     "mapping", [this] { Run(); }, [this](const absl::Status& status) { SetStatus(status); }));
    return absl::OkStatus();
  }
  bool in_background() const { return thread_.joinable(); }

  // Waits for room. Without a thread: the error of the job.
  absl::Status Push(Job job) {
    if (!in_background()) return Guarded([&] { return handle_(job); });
    return queue_.Push(std::move(job)) ? absl::OkStatus() : absl::CancelledError("the session is ending");
  }
  // Does not wait; false if there is no room.
  bool TryPush(Job job) { return queue_.TryPush(std::move(job)); }

  absl::Status status() const {
    const std::lock_guard lock(mutex_);
    return status_;
  }

  // Ends the thread; what is queued is not done any more.
  void Abandon() {
    SetStatus(absl::CancelledError("the session was abandoned"));
    Stop();
  }
  // Does what is queued, and ends the thread.
  void Stop() {
    queue_.Close();
    if (thread_.joinable()) thread_.join();
  }

 private:
  void Run() {
    while (std::optional<Job> job = queue_.Pop()) {
      if (status().ok()) SetStatus(Guarded([&] { return handle_(*job); }));
      while (status().ok() && queue_.size() == 0 && DoMeanwhile()) {
      }
    }
  }
  bool DoMeanwhile() {
    const absl::StatusOr<bool> more = Guarded([&] { return meanwhile_(); });
    SetStatus(more.status());
    return more.ok() && *more;
  }
  void SetStatus(const absl::Status& status) {
    const std::lock_guard lock(mutex_);
    status_.Update(status);
  }

  const Handler handle_;
  const Meanwhile meanwhile_;
  BoundedQueue<Job> queue_;
  mutable std::mutex mutex_;
  absl::Status status_;
  std::thread thread_;
};

}  // namespace cairn::engine
