#include "base/object_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

namespace cairn {
namespace {

TEST(ObjectPool, UsesAgainWhatCameBackAndNothingElse) {
  ObjectPool<std::vector<int>> pool;
  std::shared_ptr<std::vector<int>> a = pool.Take(), b = pool.Take();
  EXPECT_NE(a, b);
  a->assign(1000, 7);
  const std::vector<int>* const first = a.get();
  const std::shared_ptr<const std::vector<int>> still = a;
  a.reset();
  EXPECT_EQ(pool.idle(), 0u) << "somebody holds it still";
  EXPECT_NE(pool.Take().get(), first);
  EXPECT_EQ(still->size(), 1000u);
}

TEST(ObjectPool, GivesAnObjectAsItWasLeft) {
  ObjectPool<std::vector<int>> pool;
  pool.Take()->reserve(1000);
  EXPECT_EQ(pool.idle(), 1u);
  EXPECT_GE(pool.Take()->capacity(), 1000u) << "memory is kept";
  pool.Trim();
  EXPECT_EQ(pool.idle(), 0u);
  EXPECT_EQ(pool.Take()->capacity(), 0u);
}

TEST(ObjectPool, ObjectsMayOutliveIt) {
  auto pool = std::make_unique<ObjectPool<std::vector<int>>>();
  const std::shared_ptr<std::vector<int>> object = pool->Take();
  pool.reset();
  object->push_back(1);
  EXPECT_EQ(object->size(), 1u);
}

// One thread lets go while another takes: nobody ever gets what somebody holds (also for thread sanitizers).
TEST(ObjectPool, NobodyGetsWhatAnotherThreadHolds) {
  struct Item {
    std::atomic<int> holders = 0;
    int value = 0;
  };
  ObjectPool<Item> pool;
  std::atomic<int> shared_twice = 0;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 20000; ++i) {
        std::shared_ptr<Item> item = pool.Take();
        if (item->holders.fetch_add(1) != 0) ++shared_twice;
        ++item->value;
        item->holders.fetch_sub(1);
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(shared_twice, 0);
  EXPECT_LE(pool.idle(), 4u);
}

}  // namespace
}  // namespace cairn
