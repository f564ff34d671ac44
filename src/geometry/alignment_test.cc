#include "geometry/alignment.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <limits>
#include <numbers>

#include "base/random.h"

namespace cairn {
namespace {

std::vector<Vector3d> RandomPoints(Random& random, int n, const Vector3d& sigma = Vector3d(1, 2, 0.5)) {
  std::vector<Vector3d> points;
  for (int i = 0; i < n; ++i)
    points.emplace_back(sigma.cwiseProduct(Vector3d(random.Normal(), random.Normal(), random.Normal())));
  return points;
}

std::vector<Vector3d> Apply(const Sim3& a_from_b, const std::vector<Vector3d>& b) {
  std::vector<Vector3d> a;
  for (const Vector3d& p : b) a.push_back(a_from_b * p);
  return a;
}

const Sim3 kTruth(ExpSO3(Vector3d(0.4, -1.3, 2.0)), Vector3d(3, -4, 5), 2.5);

void ExpectSame(const Sim3& x, const Sim3& y, double tolerance) {
  EXPECT_LT(AngleRad(x.rotation() * y.rotation().conjugate()), tolerance);
  EXPECT_LT((x.translation() - y.translation()).norm(), tolerance);
  EXPECT_NEAR(x.scale(), y.scale(), tolerance);
}

TEST(Alignment, ExactDataGiveTheExactTransform) {
  Random random(1);
  for (const int n : {3, 4, 100}) {
    const auto b = RandomPoints(random, n);
    const auto result = AlignPoints(Apply(kTruth, b), b);
    ASSERT_TRUE(result.ok()) << result.status();
    ExpectSame(result->a_from_b, kTruth, 1e-7);
    EXPECT_LT(result->rmse, 1e-10);
    EXPECT_EQ(result->inlier_count, n);
  }
}

TEST(Alignment, RigidKeepsTheScaleAtOne) {
  Random random(2);
  const Sim3 rigid(kTruth.rotation(), kTruth.translation(), 1.0);
  const auto b = RandomPoints(random, 20);
  const auto result = AlignPoints(Apply(rigid, b), b, {.with_scale = false});
  ASSERT_TRUE(result.ok());
  ExpectSame(result->a_from_b, rigid, 1e-9);
  EXPECT_EQ(AlignPoints(Apply(kTruth, b), b, {.with_scale = false})->a_from_b.scale(), 1.0);
}

// The points of the worked example in Umeyama 1991: in the plane their best orthogonal map is a reflection.
TEST(Alignment, ReflectionIsNotAnAnswer) {
  const std::vector<Vector3d> x = {{0, 0, 0}, {1, 0, 0}, {0, 2, 0}};
  const std::vector<Vector3d> y = {{0, 0, 0}, {-1, 0, 0}, {0, 2, 0}};
  // In the plane a mirror image is a half turn in space, so it is met exactly...
  const auto flat = AlignPoints(y, x);
  ASSERT_TRUE(flat.ok());
  EXPECT_LT(flat->rmse, 1e-12);
  EXPECT_NEAR(AngleRad(flat->a_from_b.rotation()), std::numbers::pi, 1e-9);
  // ... but in space it cannot be.
  Random random(3);
  const auto b = RandomPoints(random, 50);
  std::vector<Vector3d> a;
  for (const Vector3d& p : b) a.emplace_back(p.x(), p.y(), -p.z());
  const auto result = AlignPoints(a, b);
  ASSERT_TRUE(result.ok());
  EXPECT_NEAR(result->a_from_b.RotationMatrix().determinant(), 1.0, 1e-12);
  EXPECT_GT(result->rmse, 0.1);
  EXPECT_LT(result->a_from_b.scale(), 1.0);
}

TEST(Alignment, CostIsAtItsMinimum) {
  Random random(4);
  const auto b = RandomPoints(random, 30);
  auto a = Apply(kTruth, b);
  std::vector<double> w;
  for (Vector3d& p : a) {
    p += Vector3d(random.Normal(), random.Normal(), random.Normal()) * 0.3;
    w.push_back(random.Uniform(0.1, 2.0));
  }
  const auto cost = [&](const Sim3& t) {
    double sum = 0;
    for (std::size_t i = 0; i < a.size(); ++i) sum += w[i] * (a[i] - t * b[i]).squaredNorm();
    return sum;
  };
  const auto result = AlignPointsWeighted(a, b, w);
  ASSERT_TRUE(result.ok());
  for (int k = 0; k < 7; ++k) {
    for (const double step : {-1e-3, 1e-3}) {
      EXPECT_GT(cost(Sim3::Exp(step * Vector7d::Unit(k)) * result->a_from_b), cost(result->a_from_b));
    }
  }
}

TEST(Alignment, WeightZeroLeavesOut) {
  Random random(5);
  const auto b = RandomPoints(random, 10);
  auto a = Apply(kTruth, b);
  a[3] += Vector3d(100, 0, 0);
  std::vector<double> w(10, 2.0);
  w[3] = 0.0;
  const auto result = AlignPointsWeighted(a, b, w);
  ASSERT_TRUE(result.ok());
  ExpectSame(result->a_from_b, kTruth, 1e-9);
  EXPECT_FALSE(result->inlier[3]);
  EXPECT_EQ(result->inlier_count, 9);
}

TEST(Alignment, SigmasMatchTheScatterOfRepeatedTrials) {
  Random random(6);
  const auto b = RandomPoints(random, 40);
  const auto exact = Apply(kTruth, b);
  double scatter = 0, promised = 0;
  const int trials = 400;
  for (int k = 0; k < trials; ++k) {
    auto a = exact;
    for (Vector3d& p : a) p += 0.1 * Vector3d(random.Normal(), random.Normal(), random.Normal());
    const auto result = AlignPoints(a, b);
    ASSERT_TRUE(result.ok());
    scatter += std::pow(result->a_from_b.scale() - 2.5, 2) / trials;
    promised += std::pow(result->scale_sigma, 2) / trials;
  }
  EXPECT_NEAR(std::sqrt(scatter / promised), 1.0, 0.12);
}

TEST(Alignment, DegenerateInputSaysWhatIsMissing) {
  Random random(7);
  const auto b = RandomPoints(random, 20);
  const auto a = Apply(kTruth, b);
  const auto status = [](const std::vector<Vector3d>& pa, const std::vector<Vector3d>& pb) {
    return AlignPoints(pa, pb).status();
  };
  EXPECT_EQ(status({a[0], a[1]}, {b[0], b[1]}).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(status({}, {}).code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(status({a[0], a[1]}, {b[0]}).code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(status(std::vector<Vector3d>(5, a[0]), std::vector<Vector3d>(5, b[0])).code(),
            absl::StatusCode::kFailedPrecondition);
  auto bad = a;
  bad[2].y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(status(bad, b).code(), absl::StatusCode::kInvalidArgument);
}

TEST(Alignment, PointsOnALine) {
  std::vector<Vector3d> b;
  for (int i = 0; i < 20; ++i) b.emplace_back(Vector3d(1, 2, 3) + 0.3 * i * Vector3d(0.5, -0.2, 0.9));
  const auto a = Apply(kTruth, b);
  const auto refused = AlignPoints(a, b);
  EXPECT_EQ(refused.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_NE(refused.status().message().find("line"), std::string::npos);
  const auto result = AlignPoints(a, b, {.allow_collinear = true});
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_FALSE(result->rotation_known);
  EXPECT_NEAR(result->a_from_b.scale(), 2.5, 1e-9);
  EXPECT_LT(result->rmse, 1e-9);
}

class RobustAlignment : public testing::TestWithParam<double> {};

TEST_P(RobustAlignment, FortyPercentOutliers) {
  Random random(8);
  const auto b = RandomPoints(random, 100);
  auto a = Apply(kTruth, b);
  for (std::size_t i = 0; i < a.size(); ++i) {
    a[i] += (i % 5 < 2 ? 5.0 : 0.01) * Vector3d(random.Normal(), random.Normal(), random.Normal());
  }
  const auto result = AlignPointsRobust(a, b, {.inlier_threshold = GetParam()});
  ASSERT_TRUE(result.ok()) << result.status();
  ExpectSame(result->a_from_b, kTruth, 0.02);
  EXPECT_GE(result->inlier_count, 52);
  EXPECT_LE(result->inlier_count, 62);
  const auto again = AlignPointsRobust(a, b, {.inlier_threshold = GetParam()});
  EXPECT_EQ(again->a_from_b.scale(), result->a_from_b.scale());
}
INSTANTIATE_TEST_SUITE_P(KnownAndEstimatedThreshold, RobustAlignment, testing::Values(0.05, 0.0));

TEST(Alignment, RobustOnExactAndOnHopelessData) {
  Random random(9);
  const auto b = RandomPoints(random, 30);
  const auto exact = AlignPointsRobust(Apply(kTruth, b), b);
  ASSERT_TRUE(exact.ok()) << exact.status();
  ExpectSame(exact->a_from_b, kTruth, 1e-6);
  EXPECT_EQ(exact->inlier_count, 30);
  const auto hopeless = AlignPointsRobust(RandomPoints(random, 30), b, {.inlier_threshold = 1e-6, .min_inliers = 10});
  EXPECT_EQ(hopeless.status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_FALSE(AlignPointsRobust(b, b, {.inlier_threshold = -1}).ok());
}

}  // namespace
}  // namespace cairn
