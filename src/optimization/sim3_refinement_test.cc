#include "optimization/sim3_refinement.h"

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <cmath>

#include "base/random.h"
#include "optimization/reprojection.h"

namespace cairn::optimization {
namespace {

const Pinhole kPinholeA{640, 480, 525.0, 520.0, 320.0, 240.0};
const Pinhole kPinholeB{640, 480, 480.0, 485.0, 310.0, 250.0};

using Jet = ceres::Jet<double, 7>;
using Vector3J = Eigen::Matrix<Jet, 3, 1>;

// Exp(x) p to first order: exact derivatives at x = 0.
Vector3J Step(const Eigen::Matrix<Jet, 7, 1>& x, const Vector3J& p, double sign) {
  const Vector3J v = x.head<3>(), w = x.segment<3>(3);
  return p + Jet(sign) * (v + w.cross(p) + x[6] * p);
}

TEST(Sim3Refinement, JacobiansAgreeWithAutodiffAndDifferences) {
  Random random(3);
  for (int trial = 0; trial < 20; ++trial) {
    Vector7d tangent;
    for (int i = 0; i < 7; ++i) tangent[i] = 0.3 * random.Normal();
    const Sim3 s = Sim3::Exp(tangent);
    const Vector3d point_a(random.Normal(), random.Normal(), random.Uniform(3.0, 6.0));
    const Vector3d point_b = s.Inverse() * point_a;
    Eigen::Matrix<Jet, 7, 1> x;
    for (int i = 0; i < 7; ++i) x[i] = Jet(0.0, i);

    const Vector3J forward = Step(x, point_a.cast<Jet>(), 1.0);
    const Matrix27d by_forward = ForwardReprojectionBySim3(kPinholeA, point_a);
    const Jet u = forward.x() / forward.z() * kPinholeA.fx_px, v = forward.y() / forward.z() * kPinholeA.fy_px;
    const Matrix3d linear = s.Inverse().scale() * s.Inverse().RotationMatrix();
    const Vector3J backward =
        linear.cast<Jet>() * Step(x, point_a.cast<Jet>(), -1.0) + s.Inverse().translation().cast<Jet>();
    const Matrix27d by_backward = BackwardReprojectionBySim3(kPinholeB, s, point_a);
    const Jet p = backward.x() / backward.z() * kPinholeB.fx_px, q = backward.y() / backward.z() * kPinholeB.fy_px;
    const Jet distance = log(forward.norm());
    const auto by_distance = LogDistanceBySim3(point_a);
    for (int i = 0; i < 7; ++i) {
      EXPECT_NEAR(by_forward(0, i), u.v[i], 1e-8);
      EXPECT_NEAR(by_forward(1, i), v.v[i], 1e-8);
      EXPECT_NEAR(by_backward(0, i), p.v[i], 1e-8);
      EXPECT_NEAR(by_backward(1, i), q.v[i], 1e-8);
      EXPECT_NEAR(by_distance(0, i), distance.v[i], 1e-10);

      constexpr double kStep = 1e-6;
      const Sim3 plus = Sim3::Exp(Vector7d::Unit(i) * kStep) * s, minus = Sim3::Exp(-Vector7d::Unit(i) * kStep) * s;
      const Vector2d in_a = (kPinholeA.Project(plus * point_b) - kPinholeA.Project(minus * point_b)) / (2 * kStep);
      const Vector2d in_b =
          (kPinholeB.Project(plus.Inverse() * point_a) - kPinholeB.Project(minus.Inverse() * point_a)) / (2 * kStep);
      const double of_log = std::log((plus * point_b).norm() / (minus * point_b).norm()) / (2 * kStep);
      EXPECT_LT((in_a - by_forward.col(i)).norm(), 1e-4 * (1.0 + in_a.norm()));
      EXPECT_LT((in_b - by_backward.col(i)).norm(), 1e-4 * (1.0 + in_b.norm()));
      EXPECT_NEAR(of_log, by_distance(0, i), 1e-6);
    }
  }
}

// Two maps of the same points, each with errors of depth; the last `outliers` matches are wrong.
std::vector<Sim3Match> MakeMatches(const Sim3& a_from_b, int count, int outliers, double pixel_noise,
                                   double depth_noise, std::uint64_t seed) {
  Random random(seed);
  std::vector<Sim3Match> matches;
  while (static_cast<int>(matches.size()) < count) {
    const Vector3d point_a =
        random.Uniform(2.0, 8.0) * kPinholeA.Unproject({random.Uniform(10, 630), random.Uniform(10, 470)});
    const Vector3d point_b = a_from_b.Inverse() * point_a;
    if (point_b.z() < 0.1 || !kPinholeB.Contains(kPinholeB.Project(point_b))) continue;
    Sim3Match match;
    match.point_a = point_a * (1.0 + depth_noise * random.Normal());
    match.point_b = point_b * (1.0 + depth_noise * random.Normal());
    match.pixel_a = kPinholeA.Project(point_a) + pixel_noise * Vector2d(random.Normal(), random.Normal());
    match.pixel_b = kPinholeB.Project(point_b) + pixel_noise * Vector2d(random.Normal(), random.Normal());
    matches.push_back(match);
  }
  for (int i = 0; i < outliers; ++i) {
    Sim3Match& match = matches[static_cast<std::size_t>(count - 1 - i)];
    match.point_b = random.Uniform(2.0, 8.0) * kPinholeB.Unproject({random.Uniform(10, 630), random.Uniform(10, 470)});
    match.pixel_b = kPinholeB.Project(match.point_b);
  }
  return matches;
}

const Sim3 kTruth(ExpSO3(Vector3d(0.05, -0.2, 0.1)), Vector3d(0.3, -0.1, 0.2), 1.6);

double RotationError(const Sim3& a, const Sim3& b) { return AngleRad(a.rotation() * b.rotation().conjugate()); }

TEST(Sim3Refinement, ExactMatchesGiveTheExactAnswer) {
  const auto matches = MakeMatches(kTruth, 40, 0, 0.0, 0.0, 5);
  const Sim3 start = Sim3::Exp(0.01 * Vector7d::Ones()) * kTruth;
  const auto refined = RefineSim3(kPinholeA, kPinholeB, start, matches);
  ASSERT_TRUE(refined.ok()) << refined.status();
  EXPECT_EQ(refined->num_inliers, 40);
  EXPECT_NEAR(refined->a_from_b.scale(), 1.6, 1e-5);
  EXPECT_LT((refined->a_from_b.translation() - kTruth.translation()).norm(), 1e-5);
  EXPECT_LT(RotationError(refined->a_from_b, kTruth), 1e-6);
}

TEST(Sim3Refinement, SamplesAndRefinementSurviveHalfOutliers) {
  const auto matches = MakeMatches(kTruth, 120, 60, 0.7, 0.02, 6);
  const auto found = FindSim3(kPinholeA, kPinholeB, matches);
  ASSERT_TRUE(found.ok()) << found.status();
  EXPECT_GE(found->num_inliers, 20);
  const auto refined = RefineSim3(kPinholeA, kPinholeB, found->a_from_b, matches);
  ASSERT_TRUE(refined.ok()) << refined.status();
  EXPECT_GE(refined->num_inliers, 50);
  EXPECT_LE(refined->num_inliers, 64);
  EXPECT_NEAR(refined->a_from_b.scale(), 1.6, 0.02);
  EXPECT_LT((refined->a_from_b.translation() - kTruth.translation()).norm(), 0.05);
  EXPECT_LT(RotationError(refined->a_from_b, kTruth), 0.01);
  // Twice the same.
  const auto again = FindSim3(kPinholeA, kPinholeB, matches);
  ASSERT_TRUE(again.ok());
  EXPECT_EQ(again->inlier, found->inlier);
  EXPECT_EQ(again->a_from_b.scale(), found->a_from_b.scale());
}

TEST(Sim3Refinement, ScaleIsKnownWithoutBaseline) {
  const Sim3 truth(ExpSO3(Vector3d(0.02, 0.05, 0.0)), Vector3d(0.003, 0.0, 0.002), 1.3);
  auto matches = MakeMatches(truth, 80, 0, 0.7, 0.03, 7);
  // Half of them have no pixel in b, some only one point.
  for (std::size_t i = 0; i < matches.size(); i += 2) matches[i].has_pixel_b = false;
  for (std::size_t i = 0; i < matches.size(); i += 5) matches[i].has_point_a = false;
  const auto refined = RefineSim3(kPinholeA, kPinholeB, Sim3(truth.rotation(), truth.translation(), 1.0), matches);
  ASSERT_TRUE(refined.ok()) << refined.status();
  EXPECT_NEAR(refined->a_from_b.scale(), 1.3, 0.02);
}

TEST(Sim3Refinement, SaysWhenThereIsNoAnswer) {
  const auto random = MakeMatches(kTruth, 60, 60, 0.0, 0.0, 8);
  EXPECT_TRUE(absl::IsFailedPrecondition(FindSim3(kPinholeA, kPinholeB, random).status()));
  EXPECT_TRUE(absl::IsFailedPrecondition(FindSim3(kPinholeA, kPinholeB, {}).status()));
  EXPECT_TRUE(absl::IsFailedPrecondition(RefineSim3(kPinholeA, kPinholeB, kTruth, {}).status()));
  auto matches = MakeMatches(kTruth, 40, 0, 0.0, 0.0, 9);
  for (Sim3Match& match : matches) match.has_point_a = false;
  EXPECT_TRUE(absl::IsFailedPrecondition(RefineSim3(kPinholeA, kPinholeB, kTruth, matches).status()));
  matches[3].point_b.x() = NAN;
  EXPECT_TRUE(absl::IsInvalidArgument(FindSim3(kPinholeA, kPinholeB, matches).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(RefineSim3(kPinholeA, kPinholeB, kTruth, matches).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(FindSim3(kPinholeA, kPinholeB, {}, {.max_samples = 0}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(RefineSim3(kPinholeA, kPinholeB, kTruth, {}, {.rounds = 0}).status()));
}

}  // namespace
}  // namespace cairn::optimization
