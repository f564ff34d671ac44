#include "base/fair_mutex.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

namespace cairn {
namespace {

TEST(FairMutex, KeepsOthersOut) {
  FairMutex mutex;
  int count = 0;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&] {
      for (int k = 0; k < 1000; ++k) {
        const std::lock_guard lock(mutex);
        ++count;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(count, 4000);
}

// The one that would take it again and again lets the other in after one round: a std::mutex may keep it out for all.
TEST(FairMutex, WhoComesBackIsBehindWhoWaits) {
  FairMutex mutex;
  for (int round = 0; round < 100; ++round) {
    std::atomic<int> taken = 0;  // by the greedy one, once the other is about to wait
    std::atomic<bool> waiting = false, done = false;
    mutex.lock();
    std::thread other([&] {
      waiting = true;
      const std::lock_guard lock(mutex);
      done = true;
    });
    while (!waiting) std::this_thread::yield();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    while (!done && taken < 1000) {
      mutex.unlock();
      mutex.lock();
      ++taken;
    }
    mutex.unlock();
    other.join();
    EXPECT_LT(taken, 1000) << "round " << round;
  }
}

}  // namespace
}  // namespace cairn
