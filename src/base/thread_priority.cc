#include "base/thread_priority.h"

#include <sys/resource.h>
#include <unistd.h>

#include <cerrno>

namespace cairn {
namespace {

constexpr int kNicer = 10;  // of 19; a tenth of the usual share
constexpr int kNicest = 19;

}  // namespace

void YieldToOthers() noexcept {
  // Linux keeps a priority per thread, whatever POSIX says of processes (setpriority(2), "C library/kernel
  // differences").
  const auto thread = static_cast<id_t>(gettid());
  errno = 0;
  const int now = getpriority(PRIO_PROCESS, thread);
  if (errno != 0) return;
  setpriority(PRIO_PROCESS, thread, now + kNicer < kNicest ? now + kNicer : kNicest);
}

}  // namespace cairn
