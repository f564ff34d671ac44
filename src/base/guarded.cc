#include "base/guarded.h"

#include <exception>
#include <mutex>
#include <new>
#include <system_error>
#include <utility>
#include <vector>

#include "absl/strings/match.h"

namespace cairn {
namespace {

// Made before memory runs out: copies of it need none.
const absl::Status& OutOfMemory() {
  static const absl::Status* const status = new absl::Status(absl::ResourceExhaustedError("out of memory"));
  return *status;
}
[[maybe_unused]] const absl::Status& made_at_start = OutOfMemory();

absl::Status Translate() {
  try {
    throw;
  } catch (const std::bad_alloc&) {
    return OutOfMemory();
  } catch (const std::system_error& error) {
    if (error.code() == std::errc::resource_unavailable_try_again) {
      return absl::ResourceExhaustedError(absl::StrCat("no thread can be started: ", error.what()));
    }
    if (error.code() == std::errc::not_enough_memory) return OutOfMemory();
    return absl::UnavailableError(error.what());
  } catch (const std::exception& error) {
    // OpenCV has no exception of its own for memory.
    const absl::string_view what = error.what();
    if (absl::StrContains(what, "Insufficient memory") || absl::StrContains(what, "Failed to allocate")) {
      return OutOfMemory();
    }
    return absl::InternalError(absl::StrCat("a library failed: ", what));
  } catch (...) {
    return absl::InternalError("a library failed and did not say why");
  }
}

}  // namespace

absl::Status StatusOfException() noexcept {
  try {
    return Translate();
  } catch (...) {  // no memory for the message
    return OutOfMemory();
  }
}

absl::StatusOr<std::thread> StartThread(const std::string& name, std::function<void()> body,
                                        std::function<void(const absl::Status&)> failed) noexcept {
  try {
    return std::thread([name, body = std::move(body), failed = std::move(failed)]() noexcept {
      const absl::Status status = Guarded([&] {
        body();
        return absl::OkStatus();
      });
      if (status.ok()) return;
      const absl::Status named = Guarded([&] { return Annotate(status, name); });
      failed(named);
    });
  } catch (...) {
    const absl::Status status = StatusOfException();
    return Guarded([&] { return Annotate(status, name); });
  }
}

void RunInThreads(int threads, const std::function<void()>& work) {
  std::mutex mutex;  // guards thrown
  std::exception_ptr thrown;
  const auto guarded = [&]() noexcept {
    try {
      work();
    } catch (...) {
      std::lock_guard lock(mutex);
      if (!thrown) thrown = std::current_exception();
    }
  };
  std::vector<std::thread> others;
  try {
    for (int i = 1; i < threads; ++i) others.emplace_back(guarded);
  } catch (...) {  // those that there are do it
  }
  guarded();
  for (std::thread& thread : others) thread.join();
  if (thrown) std::rethrow_exception(thrown);
}

}  // namespace cairn
