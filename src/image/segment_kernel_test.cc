#include "image/segment_kernel.h"

#include <gtest/gtest.h>

#include <vector>

#include "base/cpu_features.h"
#include "base/random.h"

namespace cairn::image::internal {
namespace {

TEST(SegmentKernel, EveryLevelGivesTheSame) {
  if (ActiveSimdLevel() == SimdLevel::kBaseline) GTEST_SKIP() << "no AVX2";
  Random random(3);
  std::size_t found = 0;
  for (int trial = 0; trial < 5000; ++trial) {
    std::vector<GridEntry> entries(random.Below(40));
    for (std::uint32_t i = 0; i < entries.size(); ++i) {
      // On a grid, so that many lie exactly on the limit.
      entries[i] = {static_cast<float>(random.Below(32)), static_cast<float>(random.Below(32)), 100 + i,
                    static_cast<std::uint32_t>(random.Below(8))};
    }
    SegmentQuery query = {};
    query.begin_x = static_cast<double>(random.Below(32)), query.begin_y = static_cast<double>(random.Below(32));
    query.dx = static_cast<double>(random.Below(20)) - 10.0;
    query.dy = trial % 3 == 0 ? 0.0 : random.Uniform(-10.0, 10.0);
    const double squared = query.dx * query.dx + query.dy * query.dy;
    query.inverse_squared = squared > 0.0 ? 1.0 / squared : 0.0;
    query.half_width_squared = static_cast<double>(random.Below(30));
    query.low_octave = static_cast<std::uint32_t>(random.Below(6));
    query.octaves = static_cast<std::uint32_t>(random.Below(4));
    std::vector<std::uint32_t> want(entries.size() + kSegmentSlack), got(entries.size() + kSegmentSlack);
    want.resize(NearSegmentPortable(entries.data(), entries.size(), query, want.data()));
    got.resize(NearSegmentAvx2(entries.data(), entries.size(), query, got.data()));
    ASSERT_EQ(got, want) << trial;
    found += want.size();
  }
  EXPECT_GT(found, 1000u);
}

}  // namespace
}  // namespace cairn::image::internal
