#include "tracking/relative_scale.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/random.h"

namespace cairn::tracking {
namespace {

TEST(RelativeScale, FromCentresWithOutliers) {
  Random random(1);
  std::vector<Vector3d> map, direct;
  for (int i = 0; i < 30; ++i) {
    direct.emplace_back(0.1 * i, std::sin(0.3 * i), 0.05 * i);
    map.push_back(2.5 * (ExpSO3(Vector3d(0.1, 0.2, 0.3)) * direct.back()) + Vector3d(1, 2, 3) +
                  0.005 * Vector3d(random.Normal(), random.Normal(), random.Normal()));
  }
  map[7] += Vector3d(3, 0, 0);
  map[20] -= Vector3d(0, 2, 0);
  const auto scale = ScaleFromCentres(map, direct);
  ASSERT_TRUE(scale);
  EXPECT_NEAR(scale->scale, 2.5, 0.02);
  EXPECT_GT(scale->relative_sigma, 0.0);
  EXPECT_LT(scale->relative_sigma, 0.02);
  EXPECT_FALSE(ScaleFromCentres(std::span(map).first(9), std::span(direct).first(9))) << "the window starts at 10";
  const std::vector<Vector3d> still(12, Vector3d(1, 1, 1));
  EXPECT_FALSE(ScaleFromCentres(still, still)) << "no motion, no scale";
}

TEST(RelativeScale, FromDepthsAndFrozenAfterALoss) {
  Random random(2);
  std::vector<double> ratios;
  for (int i = 0; i < 60; ++i) ratios.push_back(1.7 * std::exp(0.05 * random.Normal()));
  for (int i = 0; i < 10; ++i) ratios.push_back(random.Uniform(0.1, 10.0));
  const auto measured = ScaleFromDepths(ratios);
  ASSERT_TRUE(measured);
  EXPECT_NEAR(measured->scale, 1.7, 0.05);
  EXPECT_FALSE(ScaleFromDepths(std::span(ratios).first(10))) << "too few";
  for (double& ratio : ratios) ratio = std::exp(3.0 * random.Normal());
  EXPECT_FALSE(ScaleFromDepths(ratios)) << "they disagree";

  RelativeScale scale;
  EXPECT_EQ(scale.relative_sigma(), 0.0);
  scale.Update(measured, std::nullopt);
  EXPECT_EQ(scale.scale(), measured->scale);
  scale.Update(std::nullopt, std::nullopt);
  EXPECT_EQ(scale.scale(), measured->scale) << "frozen";
  scale.Update(ScaleMeasurement{2.0 * measured->scale, 0.01}, std::nullopt);
  EXPECT_GT(scale.scale(), measured->scale);
  EXPECT_LT(scale.scale(), 2.0 * measured->scale) << "smoothed";
  scale.Update(std::nullopt, ScaleMeasurement{3.0, 0.01});
  EXPECT_EQ(scale.scale(), 3.0);
}

}  // namespace
}  // namespace cairn::tracking
