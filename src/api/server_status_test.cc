#include "api/server_status.h"

#include <gtest/gtest.h>

namespace cairn::api {
namespace {

TEST(DurationHistogram, QuantilesLieInTheirBuckets) {
  const DurationHistogram histogram{{0.01, 0.02, 0.04}, {10, 80, 8, 2}, 1.7};
  EXPECT_EQ(histogram.total(), 100);
  EXPECT_DOUBLE_EQ(histogram.Quantile(0.05), 0.005);
  EXPECT_DOUBLE_EQ(histogram.Quantile(0.5), 0.015);
  EXPECT_DOUBLE_EQ(histogram.Quantile(0.98), 0.04);
  EXPECT_DOUBLE_EQ(histogram.Quantile(1.0), 0.04) << "longer ones count as the last bound";
  EXPECT_EQ(DurationHistogram().Quantile(0.5), 0.0);
}

TEST(DurationHistogram, WhatCameSince) {
  const DurationHistogram before{{0.01, 0.02}, {5, 5, 0}, 0.1}, now{{0.01, 0.02}, {5, 9, 1}, 0.3};
  const DurationHistogram since = now.Since(before);
  EXPECT_EQ(since.counts, (std::vector<std::int64_t>{0, 4, 1}));
  EXPECT_NEAR(since.sum_s, 0.2, 1e-12);
  EXPECT_EQ(before.Since(now).counts, before.counts) << "of a server that was started anew: all of it";
  EXPECT_EQ(now.Since({}).counts, now.counts);
}

}  // namespace
}  // namespace cairn::api
