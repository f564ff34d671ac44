#include "base/thread_priority.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <thread>

namespace cairn {
namespace {

int Niceness() { return getpriority(PRIO_PROCESS, static_cast<id_t>(gettid())); }

TEST(ThreadPriority, IsOfTheCallingThreadAlone) {
  const int before = Niceness();
  int of_the_other = -1000;
  std::thread([&] {
    YieldToOthers();
    of_the_other = Niceness();
  }).join();
  EXPECT_EQ(of_the_other, std::min(19, before + 10));
  EXPECT_EQ(Niceness(), before);
}

}  // namespace
}  // namespace cairn
