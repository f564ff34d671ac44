#include "base/sample_reservoir.h"

#include <gtest/gtest.h>

namespace cairn {
namespace {

TEST(SampleReservoir, IsExactWhileAllAreKept) {
  SampleReservoir samples(100);
  EXPECT_EQ(samples.Percentile(0.5), 0.0);
  EXPECT_EQ(samples.mean(), 0.0);
  for (int i = 100; i > 0; --i) samples.Add(static_cast<float>(i));
  EXPECT_EQ(samples.count(), 100);
  EXPECT_EQ(samples.mean(), 50.5);
  EXPECT_EQ(samples.min(), 1.0);
  EXPECT_EQ(samples.max(), 100.0);
  EXPECT_EQ(samples.Percentile(0.5), 50.0);
  EXPECT_EQ(samples.Percentile(0.0), 1.0);
  EXPECT_EQ(samples.Percentile(1.0), 100.0);
  EXPECT_EQ(samples.kept().front(), 100.0f);
}

TEST(SampleReservoir, KeepsAFairChoiceOfAStreamWithoutEnd) {
  constexpr int kSamples = 1'000'000;
  SampleReservoir samples(2000);
  for (int i = 1; i <= kSamples; ++i) samples.Add(static_cast<float>(i));
  EXPECT_EQ(samples.kept().size(), 2000u);
  EXPECT_EQ(samples.kept().capacity(), 2048u) << "bounded";
  EXPECT_EQ(samples.count(), kSamples);
  EXPECT_DOUBLE_EQ(samples.mean(), 0.5 * (kSamples + 1));
  EXPECT_EQ(samples.min(), 1.0);
  EXPECT_EQ(samples.max(), kSamples);
  // Of 2000 uniform samples the median has a standard deviation of 1.1 %.
  EXPECT_NEAR(samples.Percentile(0.5), 0.5 * kSamples, 0.05 * kSamples);
  EXPECT_NEAR(samples.Percentile(0.99), 0.99 * kSamples, 0.01 * kSamples);
}

TEST(SampleReservoir, IsTheSameInEveryRun) {
  SampleReservoir a(10), b(10);
  for (int i = 0; i < 1000; ++i) a.Add(static_cast<float>(i)), b.Add(static_cast<float>(i));
  EXPECT_EQ(a.kept(), b.kept());
}

}  // namespace
}  // namespace cairn
