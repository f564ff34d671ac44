// What a library throws ends at the boundary, as a Status: of a call, and of a thread, where it would end the process.
//
//   absl::StatusOr<cv::Mat> image = Guarded([&] { return Decode(bytes); });
//   CAIRN_ASSIGN_OR_RETURN(thread_, StartThread("reading images", [this] { Work(); },
//                                               [this](const absl::Status& status) { End(status); }));
#pragma once

#include <functional>
#include <string>
#include <thread>

#include "base/status.h"

namespace cairn {

// Of the exception that is being handled: only in a catch block. ResourceExhausted for memory and threads that ran out;
// Internal, with what the library says, otherwise.
absl::Status StatusOfException() noexcept;

// Calls `function`, which returns a Status or a StatusOr; what it throws becomes one.
template <class Function>
auto Guarded(Function&& function) noexcept -> decltype(function()) {
  try {
    return function();
  } catch (...) {
    return StatusOfException();
  }
}

// Runs `body` in a new thread. If it throws, `failed` is called there with the error ("reading images: out of memory"),
// so that who waits for the thread can be told; `failed` must not throw, nor wait. ResourceExhausted if no thread can
// be started: neither is called then.
absl::StatusOr<std::thread> StartThread(const std::string& name, std::function<void()> body,
                                        std::function<void(const absl::Status&)> failed) noexcept;

// Calls `work` in this thread and in `threads` - 1 others, fewer if they cannot be started, and returns when all have
// returned. What it throws in any of them is thrown here.
void RunInThreads(int threads, const std::function<void()>& work);

}  // namespace cairn
