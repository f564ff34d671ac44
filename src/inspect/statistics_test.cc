#include "inspect/statistics.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "map/testing_map.h"

namespace cairn::inspect {
namespace {

TEST(Distribute, CountsEveryValueOnce) {
  std::vector<double> values;
  for (int i = 0; i < 1000; ++i) values.push_back(0.01 * i);
  values.push_back(1e6);
  values.push_back(std::numeric_limits<double>::quiet_NaN());
  const Distribution d = Distribute("x", "", values, false);
  EXPECT_EQ(d.count, 1001);
  EXPECT_EQ(d.min, 0.0);
  EXPECT_EQ(d.max, 1e6);
  EXPECT_NEAR(d.median, 5.0, 0.02);
  EXPECT_NEAR(d.p90, 9.0, 0.02);
  ASSERT_EQ(d.bins.size(), static_cast<std::size_t>(kBins));
  EXPECT_EQ(std::accumulate(d.bins.begin(), d.bins.end(), std::int64_t{0}), d.count);
  // One far value does not push all others into one bin.
  EXPECT_NEAR(static_cast<double>(d.bins[0]), 1000.0 / kBins, 3.0);
}

TEST(Distribute, WholeNumbersHaveWholeSteps) {
  const Distribution d = Distribute("x", "", {2, 2, 2, 3, 5, 5}, true);
  EXPECT_EQ(d.low, 2.0);
  EXPECT_EQ(d.step, 1.0);
  EXPECT_EQ(d.bins, (std::vector<std::int64_t>{3, 1, 0, 2}));
  std::vector<double> many(101);
  std::iota(many.begin(), many.end(), 0.0);
  const Distribution wide = Distribute("x", "", many, true);
  EXPECT_EQ(wide.step, 5.0);
  EXPECT_EQ(wide.bins[0], 5);
}

TEST(Distribute, OfNothingAndOfOneValue) {
  EXPECT_EQ(Distribute("x", "", {}, false).count, 0);
  EXPECT_TRUE(Distribute("x", "", {}, false).bins.empty());
  const Distribution one = Distribute("x", "", {4.0, 4.0}, false);
  EXPECT_EQ(one.bins, (std::vector<std::int64_t>{2}));
  EXPECT_EQ(one.mean, 4.0);
}

TEST(Statistics, OfAMapThatIsKnown) {
  const auto world = map::testing::MakeMap(5, 6, 300, 0.5);
  const auto find = [](const std::vector<Distribution>& all, const std::string& name) {
    const auto at = std::ranges::find(all, name, &Distribution::name);
    return at == all.end() ? Distribution() : *at;
  };
  const auto all = Statistics(*world.snapshot);
  const Distribution observations = find(all, "observations_per_point");
  EXPECT_EQ(observations.count, static_cast<std::int64_t>(world.snapshot->points().size()));
  EXPECT_EQ(observations.min, 2.0);
  EXPECT_EQ(observations.max, 6.0);
  // The cameras are 0.1 s apart.
  EXPECT_NEAR(find(all, "track_s").max, 0.5, 1e-9);
  EXPECT_NEAR(find(all, "keyframe_error_px").mean, 0.5 * std::sqrt(2.0), 0.1);
  EXPECT_EQ(find(all, "points_per_keyframe").count, 6);
  EXPECT_EQ(find(all, "sessions_per_point").max, 1.0);
  EXPECT_EQ(find(Statistics(*world.snapshot, SessionId(1)), "points_per_keyframe").count, 6);
  EXPECT_EQ(find(Statistics(*world.snapshot, SessionId(2)), "points_per_keyframe").count, 0);
}

}  // namespace
}  // namespace cairn::inspect
