#include "cli/interrupt.h"

#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <csignal>
#include <cstdint>
#include <iostream>
#include <utility>

#include "base/guarded.h"

namespace cairn::cli {
namespace {

constexpr int kRepetitionMs = 500;  // without a signal, until one is a second one

sigset_t WatchedSignals() {
  sigset_t signals;
  sigemptyset(&signals);
  sigaddset(&signals, SIGINT);
  sigaddset(&signals, SIGTERM);
  struct sigaction hangup = {};
  const bool ignored = sigaction(SIGHUP, nullptr, &hangup) == 0 && hangup.sa_handler == SIG_IGN;  // nohup
  if (!ignored) sigaddset(&signals, SIGHUP);
  return signals;
}

}  // namespace

InterruptWatch::InterruptWatch() : signals_(WatchedSignals()) {
  pipe_handler_ = std::signal(SIGPIPE, SIG_IGN);
  wake_fd_ = eventfd(0, EFD_CLOEXEC);
  signal_fd_ = signalfd(-1, &signals_, SFD_CLOEXEC);
  if (wake_fd_ < 0 || signal_fd_ < 0) return;  // signals then end the process, as they do without a watch
  pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
  absl::StatusOr<std::thread> thread = StartThread(
      "waiting for signals", [this] { Wait(); }, [](const absl::Status&) {});
  if (thread.ok()) {
    thread_ = *std::move(thread);
  } else {
    pthread_sigmask(SIG_UNBLOCK, &signals_, nullptr);
  }
}

InterruptWatch::~InterruptWatch() {
  if (thread_.joinable()) {
    const std::uint64_t one = 1;
    if (write(wake_fd_, &one, sizeof(one)) == sizeof(one)) {
      thread_.join();
    } else {
      thread_.detach();
    }
    pthread_sigmask(SIG_UNBLOCK, &signals_, nullptr);
  }
  if (pipe_handler_ != SIG_ERR) std::signal(SIGPIPE, pipe_handler_);
  if (wake_fd_ >= 0) close(wake_fd_);
  if (signal_fd_ >= 0) close(signal_fd_);
}

void InterruptWatch::Wait() {
  pollfd watched[2] = {{signal_fd_, POLLIN, 0}, {wake_fd_, POLLIN, 0}};
  while (poll(watched, 2, -1) < 0) {
  }
  signalfd_siginfo info = {};
  if ((watched[0].revents & POLLIN) == 0 || read(signal_fd_, &info, sizeof(info)) != sizeof(info)) return;
  std::cerr << "\ncairn: interrupted, finishing; a second signal ends it at once\n";
  {
    std::lock_guard lock(mutex_);
    signal_ = static_cast<int>(info.ssi_signo);
    if (stop_) {
      stopped_by_ = signal_;
      stop_();
    }
  }
  // A terminal that closes hangs up more than once, and who ends a process often signals its group as well: neither is
  // impatience. After that the next one takes its usual course, in this thread.
  std::signal(SIGHUP, SIG_IGN);
  watched[0].revents = 0;
  while (poll(watched, 2, kRepetitionMs) > 0 && (watched[1].revents & POLLIN) == 0) {
    if (read(signal_fd_, &info, sizeof(info)) != sizeof(info)) break;
  }
  pthread_sigmask(SIG_UNBLOCK, &signals_, nullptr);
  while (poll(&watched[1], 1, -1) < 0) {
  }
}

InterruptWatch::Guard::Guard(InterruptWatch* watch, std::function<void()> stop) : watch_(watch) {
  std::lock_guard lock(watch_->mutex_);
  watch_->stop_ = std::move(stop);
  if (watch_->signal_ != 0) {
    watch_->stopped_by_ = watch_->signal_;
    watch_->stop_();
  }
}

InterruptWatch::Guard::~Guard() {
  std::lock_guard lock(watch_->mutex_);
  watch_->stop_ = nullptr;
}

bool InterruptWatch::signalled() const {
  std::lock_guard lock(mutex_);
  return signal_ != 0;
}

int InterruptWatch::exit_code() const {
  std::lock_guard lock(mutex_);
  return stopped_by_ == 0 ? 0 : 128 + stopped_by_;
}

}  // namespace cairn::cli
