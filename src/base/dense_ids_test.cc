#include "base/dense_ids.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/ids.h"
#include "base/random.h"

namespace cairn {
namespace {

TEST(DenseIds, SortedLikeAnyOthers) {
  Random random(2);
  // Dense, with gaps, and so far apart that marking them would take too much memory.
  for (const std::uint64_t range : {10ull, 1000ull, 4'000'000'000ull}) {
    for (const int count : {0, 1, 7, 300}) {
      std::vector<PointId> ids;
      for (int i = 0; i < count; ++i) ids.push_back(PointId(static_cast<PointId::Value>(1 + random.Below(range))));
      std::vector<PointId> want = ids;
      std::sort(want.begin(), want.end());
      want.erase(std::unique(want.begin(), want.end()), want.end());
      SortUnique(&ids);
      EXPECT_EQ(ids, want) << count << " below " << range;
    }
  }
}

}  // namespace
}  // namespace cairn
