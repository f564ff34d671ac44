// Ctrl-C (SIGINT), SIGTERM, and the end of the terminal (SIGHUP, unless nohup says to ignore it) end a verb early but
// in order: what was done so far is finished and written. A second one, but of SIGHUP, ends the process at once.
// Meanwhile a reader
// of the output that goes away (SIGPIPE) ends nothing.
#pragma once

#include <signal.h>

#include <functional>
#include <mutex>
#include <thread>

namespace cairn::cli {

class InterruptWatch {
 public:
  // Make it before any other thread: signals are blocked in this thread and those it starts, and awaited in one.
  InterruptWatch();
  ~InterruptWatch();
  InterruptWatch(const InterruptWatch&) = delete;
  InterruptWatch& operator=(const InterruptWatch&) = delete;

  // Until it goes, the first signal calls `stop`, from another thread; at once if there was one already.
  class Guard {
   public:
    Guard(InterruptWatch* watch, std::function<void()> stop);
    ~Guard();
    Guard(const Guard&) = delete;
    Guard& operator=(const Guard&) = delete;

   private:
    InterruptWatch* watch_;
  };

  // Whether there was one, whoever was to be stopped.
  bool signalled() const;
  // 128 + the signal that called a `stop`, as shells count; 0 if none did.
  int exit_code() const;

 private:
  void Wait();

  sigset_t signals_;
  void (*pipe_handler_)(int) = nullptr;
  int wake_fd_ = -1;
  int signal_fd_ = -1;
  mutable std::mutex mutex_;  // guards what follows
  std::function<void()> stop_;
  int signal_ = 0;
  int stopped_by_ = 0;
  std::thread thread_;
};

}  // namespace cairn::cli
