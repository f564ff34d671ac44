#include "store/offered_work.h"

#include <gtest/gtest.h>

#include <atomic>
#include <latch>
#include <thread>

namespace cairn::store {
namespace {

TEST(OfferedWork, IsDoneByBothAndEndsWhenBothHave) {
  OfferedWork work;
  std::thread helper([&] { work.Help(); });
  for (int round = 0; round < 100; ++round) {
    std::latch both(2);
    std::atomic<int> done = 0;
    work.Share(
        [&] {
          both.arrive_and_wait();  // forever, if nobody helps
          ++done;
        },
        [&] {
          both.arrive_and_wait();
          std::this_thread::yield();
          ++done;
        });
    EXPECT_EQ(done, 2) << round;
  }
  work.End();
  helper.join();
}

TEST(OfferedWork, IsDoneAloneWhereNobodyHelps) {
  OfferedWork work;
  int mine = 0, theirs = 0;
  work.Share([&] { ++mine; }, [&] { ++theirs; });
  EXPECT_EQ(mine, 1);
  EXPECT_EQ(theirs, 0);
  work.End();
  work.Help();  // returns
  EXPECT_EQ(theirs, 0);
}

}  // namespace
}  // namespace cairn::store
