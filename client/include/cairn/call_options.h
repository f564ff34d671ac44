/// \file
/// How long a call may take, and how another thread ends it early.
#pragma once

#include <atomic>
#include <chrono>

#include "cairn/export.h"

CAIRN_BEGIN_NAMESPACE

/// Ends calls from another thread. Any number of calls may share one. Thread-safe.
class Cancellation {
 public:
  Cancellation() = default;
  Cancellation(const Cancellation&) = delete;
  Cancellation& operator=(const Cancellation&) = delete;

  /// Calls that were given this object end with kCancelled, those that come later, too.
  void Cancel() noexcept { cancelled_.store(true, std::memory_order_release); }
  /// Whether Cancel() was called.
  bool cancelled() const noexcept { return cancelled_.load(std::memory_order_acquire); }

 private:
  std::atomic<bool> cancelled_{false};
};

/// A call looks at both before it begins and between steps of its work, and ends no step early. Over a map file in this
/// process: Map::Open looks before and after loading, NewTracker before and after making it, Map::Refresh before,
/// Localize before the image is converted and before it is looked for, which takes some tens of milliseconds. Track
/// looks before the image is followed and, where the camera is lost, before each of the steps of looking for it: then
/// the answer is kLost, with the time as its reason, as the image has been worked on. An answer that is ready is
/// returned, late or not. After kDeadlineExceeded or kCancelled nothing has changed.
struct CallOptions {
  /// The call ends with kDeadlineExceeded after this. Never by default.
  std::chrono::steady_clock::time_point deadline = std::chrono::steady_clock::time_point::max();
  /// May be null; must live until the call returns.
  const Cancellation* cancellation = nullptr;

  /// A deadline so much from now; none if that is beyond what the clock can count.
  static CallOptions Within(std::chrono::nanoseconds time) noexcept {
    using Clock = std::chrono::steady_clock;
    CallOptions options;
    const Clock::time_point now = Clock::now();
    if (time < Clock::time_point::max() - now)
      options.deadline = now + std::chrono::duration_cast<Clock::duration>(time);
    return options;
  }
};

CAIRN_END_NAMESPACE
