#include "optimization/pose_refinement.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "base/random.h"

namespace cairn::optimization {
namespace {

const Pinhole kPinhole{640, 480, 525.0, 520.0, 318.0, 242.0};

SE3 Turned(Random& random, double translation, double rotation_rad) {
  Vector6d tangent;
  for (int i = 0; i < 6; ++i) tangent[i] = random.Normal() * (i < 3 ? translation : rotation_rad);
  return SE3::Exp(tangent);
}

// Points in front of a camera at `truth`, with pixel noise.
std::vector<PoseObservation> Observe(const SE3& truth, int count, double noise, Random& random) {
  std::vector<PoseObservation> observations;
  for (int i = 0; i < count; ++i) {
    const Vector2d pixel(random.Uniform(0, 639), random.Uniform(0, 479));
    PoseObservation o;
    o.sigma_px = std::pow(1.2, static_cast<double>(random.Below(8)));
    o.point = truth.Inverse() * (random.Uniform(0.5, 6.0) * kPinhole.Unproject(pixel));
    o.pixel = pixel + noise * o.sigma_px * Vector2d(random.Normal(), random.Normal());
    observations.push_back(o);
  }
  return observations;
}

double RotationErrorRad(const SE3& a, const SE3& b) { return AngleRad((a * b.Inverse()).rotation()); }
double CenterError(const SE3& a, const SE3& b) {
  return (a.Inverse().translation() - b.Inverse().translation()).norm();
}

TEST(Reprojection, JacobiansAgreeWithDifferences) {
  Random random(1);
  for (int trial = 0; trial < 20; ++trial) {
    const SE3 pose = Turned(random, 1.0, 1.0);
    const Vector3d point_c(random.Uniform(-1, 1), random.Uniform(-1, 1), random.Uniform(0.5, 4));
    const Vector3d point = pose.Inverse() * point_c;
    const Vector2d pixel(100, 200);
    const Matrix26d by_pose = ReprojectionByPose(kPinhole, point_c);
    const Matrix23d by_point = ReprojectionByPoint(kPinhole, pose.RotationMatrix(), point_c);
    const double h = 1e-6;
    const auto with_focal = [&](double log_factor) {
      Pinhole scaled = kPinhole;
      scaled.fx_px *= std::exp(log_factor);
      scaled.fy_px *= std::exp(log_factor);
      return ReprojectionResidual(scaled, point_c, pixel);
    };
    const Vector2d by_focal = (with_focal(h) - with_focal(-h)) / (2 * h);
    EXPECT_LT((by_focal - ReprojectionByLogFocal(kPinhole, point_c)).norm(), 1e-4 * (1.0 + by_focal.norm()));
    for (int k = 0; k < 6; ++k) {
      const Vector6d x = Vector6d::Unit(k) * h;
      const Vector2d difference = (ReprojectionResidual(kPinhole, (SE3::Exp(x) * pose) * point, pixel) -
                                   ReprojectionResidual(kPinhole, (SE3::Exp(-x) * pose) * point, pixel)) /
                                  (2 * h);
      EXPECT_LT((difference - by_pose.col(k)).norm(), 1e-4 * (1.0 + by_pose.col(k).norm()));
    }
    for (int k = 0; k < 3; ++k) {
      const Vector3d x = Vector3d::Unit(k) * h;
      const Vector2d difference = (ReprojectionResidual(kPinhole, pose * (point + x), pixel) -
                                   ReprojectionResidual(kPinhole, pose * (point - x), pixel)) /
                                  (2 * h);
      EXPECT_LT((difference - by_point.col(k)).norm(), 1e-4 * (1.0 + by_point.col(k).norm()));
    }
  }
}

TEST(Reprojection, HuberIsSmoothAtItsThreshold) {
  const HuberLoss loss{2.0};
  EXPECT_DOUBLE_EQ(loss.Value(3.0), 3.0);
  EXPECT_NEAR(loss.Value(4.0 + 1e-9), 4.0, 1e-8);
  EXPECT_DOUBLE_EQ(loss.Value(16.0), 12.0);
  EXPECT_DOUBLE_EQ(loss.Weight(3.0), 1.0);
  EXPECT_DOUBLE_EQ(loss.Weight(16.0), 0.5);
}

TEST(RefinePose, FindsTheExactPose) {
  Random random(2);
  for (int trial = 0; trial < 10; ++trial) {
    const SE3 truth = Turned(random, 1.0, 1.0);
    const auto observations = Observe(truth, 50, 0.0, random);
    const auto refined = RefinePose(kPinhole, Turned(random, 0.05, 0.05) * truth, observations);
    ASSERT_TRUE(refined.ok()) << refined.status();
    EXPECT_LT(CenterError(refined->camera_from_map, truth), 1e-6);
    EXPECT_LT(RotationErrorRad(refined->camera_from_map, truth), 1e-6);
    EXPECT_EQ(refined->num_inliers, 50);
    EXPECT_LT(refined->chi2, 1e-8);
  }
}

TEST(RefinePose, WithstandsFortyPercentOutliers) {
  Random random(3);
  for (int trial = 0; trial < 10; ++trial) {
    const SE3 truth = Turned(random, 1.0, 1.0);
    auto observations = Observe(truth, 200, 0.7, random);
    for (int i = 0; i < 80; ++i) observations[i].pixel = {random.Uniform(0, 639), random.Uniform(0, 479)};
    const auto refined = RefinePose(kPinhole, Turned(random, 0.02, 0.02) * truth, observations);
    ASSERT_TRUE(refined.ok()) << refined.status();
    EXPECT_LT(CenterError(refined->camera_from_map, truth), 0.02);
    EXPECT_LT(RotationErrorRad(refined->camera_from_map, truth), 0.01);
    int wrong = 0, missed = 0;
    for (int i = 0; i < 200; ++i) (i < 80 ? wrong : missed) += refined->inlier[i] == (i < 80 ? 1 : 0);
    EXPECT_LE(wrong, 2);
    EXPECT_LE(missed, 12);
  }
}

TEST(RefinePose, CovarianceTellsTheSpread) {
  Random random(4);
  const SE3 truth = Turned(random, 1.0, 1.0);
  const auto exact = Observe(truth, 100, 0.0, random);
  Matrix6d sampled = Matrix6d::Zero(), predicted = Matrix6d::Zero();
  const int trials = 400;
  for (int trial = 0; trial < trials; ++trial) {
    auto observations = exact;
    for (auto& o : observations) o.pixel += o.sigma_px * Vector2d(random.Normal(), random.Normal());
    PoseRefinementOptions options;
    options.rounds = 1;  // no rejection: the estimate is linear in the noise
    options.huber_threshold = 100.0;
    options.chi2_threshold = 100.0;
    const auto refined = RefinePose(kPinhole, truth, observations, options);
    ASSERT_TRUE(refined.ok());
    const Vector6d error = (refined->camera_from_map * truth.Inverse()).Log();
    sampled += error * error.transpose() / trials;
    predicted += refined->covariance / trials;
  }
  for (int k = 0; k < 6; ++k) EXPECT_NEAR(sampled(k, k) / predicted(k, k), 1.0, 0.25) << k;

  // The same spread seen from the inverse.
  const Matrix6d inverse = CovarianceOfInverse(truth, predicted);
  Vector6d x = Vector6d::Unit(1) * 1e-4;
  const Vector6d moved = ((SE3::Exp(x) * truth).Inverse() * truth).Log();
  EXPECT_LT((moved + truth.Inverse().Adjoint() * x).norm(), 1e-7);
  EXPECT_NEAR(inverse.determinant() / predicted.determinant(), 1.0, 1e-6);
}

TEST(RefinePose, SaysWhatIsWrong) {
  Random random(5);
  const SE3 truth;
  const auto observations = Observe(truth, 10, 0.0, random);
  EXPECT_EQ(RefinePose(kPinhole, truth, {}).status().code(), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(RefinePose(kPinhole, truth, std::span(observations).first(3)).status().code(),
            absl::StatusCode::kFailedPrecondition);

  auto bad = observations;
  bad[4].sigma_px = 0.0;
  const auto status = RefinePose(kPinhole, truth, bad).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("observation 4"));
  bad = observations;
  bad[2].point.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(RefinePose(kPinhole, truth, bad).status().code(), absl::StatusCode::kInvalidArgument);

  PoseRefinementOptions options;
  options.rounds = 0;
  EXPECT_EQ(RefinePose(kPinhole, truth, observations, options).status().code(), absl::StatusCode::kInvalidArgument);

  // All behind the camera.
  auto behind = observations;
  for (auto& o : behind) o.point.z() *= -1.0;
  EXPECT_EQ(RefinePose(kPinhole, truth, behind).status().code(), absl::StatusCode::kFailedPrecondition);

  // One and the same point.
  const std::vector<PoseObservation> same(20, observations[0]);
  EXPECT_EQ(RefinePose(kPinhole, truth, same).status().code(), absl::StatusCode::kFailedPrecondition);
}

// Few points that leave the depth nearly open: what odometry knows closes it, and many good points overrule it.
TEST(PoseRefinementPrior, HoldsWhatTheObservationsLeaveOpen) {
  const Pinhole pinhole{640, 480, 500.0, 500.0, 320.0, 240.0};
  Random random(11);
  const SE3 truth(ExpSO3(Vector3d(0.02, -0.03, 0.01)), Vector3d(0.1, -0.05, 0.2));
  for (const int count : {6, 300}) {
    std::vector<PoseObservation> observations;
    for (int i = 0; i < count; ++i) {
      // A small far patch when there are few.
      const double width = count < 10 ? 0.3 : 2.0;
      const Vector3d point(random.Uniform(-width, width), random.Uniform(-width, width), random.Uniform(4.9, 5.1));
      const Vector2d noise(random.Normal(), random.Normal());
      observations.push_back({point, pinhole.Project(truth * point) + 0.7 * noise, 1.0});
    }
    PoseRefinementOptions options;
    Vector6d error;
    error << 0.004, -0.004, 0.004, 0.001, -0.001, 0.001;
    const SE3 guess = SE3::Exp(error) * truth;
    options.prior = PosePrior{guess, 0.005, 0.001};
    const auto refined = RefinePose(pinhole, guess, observations, options);
    ASSERT_TRUE(refined.ok()) << refined.status();
    const double with_prior = (refined->camera_from_map * truth.Inverse()).Log().norm();
    EXPECT_LT(with_prior, 0.015);
    EXPECT_LT(refined->covariance.diagonal().head<3>().maxCoeff(), 0.006 * 0.006 * 4.0);
    options.prior.reset();
    const auto without = RefinePose(pinhole, guess, observations, options);
    ASSERT_TRUE(without.ok());
    const double alone = (without->camera_from_map * truth.Inverse()).Log().norm();
    if (count < 10) {
      EXPECT_LT(with_prior, alone);
    }
  }
  PoseRefinementOptions bad;
  bad.prior = PosePrior{SE3(), 0.0, 1.0};
  EXPECT_EQ(bad.Validate().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::optimization
