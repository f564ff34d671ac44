#include "optimization/focal_estimate.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>

#include "optimization/testing_photo.h"

namespace cairn::optimization {
namespace {

const Pinhole kTrue{640, 480, 525.0, 520.0, 318.0, 242.0};

Pinhole Wrong(double factor) { return WithFocal(kTrue, factor); }

// What a camera of the true focal length sees of a room.
Photo Take(std::uint64_t seed, double wrong_share = 0.1, double nearest = 1.0, double farthest = 6.0) {
  return TakePhoto(kTrue, seed, {.wrong_share = wrong_share, .nearest = nearest, .farthest = farthest});
}

// Where relocalization ends with a calibration that is wrong by a factor.
PoseRefinement Located(const Photo& photo, double factor) {
  auto pose = RefinePose(Wrong(factor), photo.camera_from_map, photo.observations);
  EXPECT_TRUE(pose.ok()) << pose.status();
  return *pose;
}

double CenterError(const SE3& a, const SE3& b) {
  return (a.Inverse().translation() - b.Inverse().translation()).norm();
}

TEST(EstimateFocal, FindsAWrongOneAndThePoseWithTheRightOne) {
  for (const double factor : {0.8, 0.9, 1.1, 1.25}) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      const Photo photo = Take(seed);
      const PoseRefinement located = Located(photo, factor);
      const auto estimate = EstimateFocal(Wrong(factor), located.camera_from_map, photo.observations);
      ASSERT_TRUE(estimate.ok()) << estimate.status();
      EXPECT_TRUE(estimate->Contradicts());
      EXPECT_NEAR(std::log(estimate->scale * factor), 0.0, 5.0 * estimate->log_sigma) << factor;
      EXPECT_LT(CenterError(estimate->camera_from_map, photo.camera_from_map), 0.05);
      EXPECT_GT(CenterError(located.camera_from_map, photo.camera_from_map), 0.1) << "or there was nothing to find";
    }
  }
}

// How the pose goes with the calibration, against poses that were found with another one.
TEST(EstimateFocal, ThePoseGoesWithTheCalibrationAsDifferencesSay) {
  const double h = 1e-4, side = kTrue.width_px;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const Photo photo = TakePhoto(kTrue, seed, {.wrong_share = 0.0, .noise = 0.0});
    const auto estimate =
        EstimateFocal(kTrue, photo.camera_from_map, photo.observations, {}, FocalPrior::WithPrincipalPoint());
    ASSERT_TRUE(estimate.ok()) << estimate.status();
    for (int k = 0; k < 3; ++k) {
      const auto pose_at = [&](double step) {
        Pinhole moved = k == 0 ? Wrong(std::exp(step)) : kTrue;
        if (k == 1) moved.cx_px += side * step;
        if (k == 2) moved.cy_px += side * step;
        return RefinePose(moved, photo.camera_from_map, photo.observations)->camera_from_map;
      };
      const Vector6d difference = (pose_at(h) * pose_at(-h).Inverse()).Log() / (2.0 * h);
      EXPECT_LT((difference - estimate->by_calibration.col(k)).norm(), 1e-3 * (1.0 + difference.norm()))
          << seed << " " << k;
    }
  }
}

TEST(EstimateFocal, ARightOneIsNotContradicted) {
  int contradicted = 0;
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    const Photo photo = Take(seed);
    const auto estimate = EstimateFocal(kTrue, Located(photo, 1.0).camera_from_map, photo.observations);
    ASSERT_TRUE(estimate.ok()) << estimate.status();
    contradicted += estimate->Contradicts() ? 1 : 0;
    sum += std::pow(std::log(estimate->scale) / estimate->log_sigma, 2) / 100.0;
  }
  EXPECT_EQ(contradicted, 0);
  EXPECT_LT(sum, 1.5);  // the sigma is honest
  EXPECT_GT(sum, 0.4);
}

TEST(EstimateFocal, CoversWhatTheCalibrationLeavesOpen) {
  for (const double factor : {0.8, 1.25}) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      const Photo photo = Take(seed);
      const PoseRefinement located = Located(photo, factor);
      const auto estimate = EstimateFocal(Wrong(factor), located.camera_from_map, photo.observations);
      ASSERT_TRUE(estimate.ok()) << estimate.status();
      const Vector6d error = (photo.camera_from_map * located.camera_from_map.Inverse()).Log();
      const Matrix6d covered = CoverFocal(located.camera_from_map, located.covariance, *estimate);
      EXPECT_GT(error.dot(located.covariance.ldlt().solve(error)), 25.0 * 6.0);
      EXPECT_LT(error.dot(covered.ldlt().solve(error)), 25.0);
    }
  }
}

// A wall that is seen straight: the focal length and the distance are one. Nothing contradicts the calibration, so the
// covariance has to cover what it may err by at worst: from half to twice the right focal length.
TEST(EstimateFocal, AFlatSceneSeenStraightLeavesItOpen) {
  for (const double factor : {0.5, 0.6, 0.8, 1.05, 1.2, 1.5, 2.0}) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      const Photo photo = Take(seed, 0.0, 3.0, 3.0);
      const PoseRefinement located = Located(photo, factor);
      const auto estimate = EstimateFocal(Wrong(factor), located.camera_from_map, photo.observations);
      ASSERT_TRUE(estimate.ok()) << estimate.status();
      EXPECT_FALSE(estimate->FocalContradicts()) << factor << " " << seed;
      EXPECT_GT(estimate->log_sigma, 0.1);
      const Vector6d error = (photo.camera_from_map * located.camera_from_map.Inverse()).Log();
      EXPECT_GT(error.dot(located.covariance.ldlt().solve(error)), 25.0 * 6.0) << "or there was nothing to cover";
      const Matrix6d covered = CoverFocal(located.camera_from_map, located.covariance, *estimate);
      const Matrix6d of_inverse = CovarianceOfInverse(located.camera_from_map, covered);
      const SE3 map_from_camera = located.camera_from_map.Inverse();
      Eigen::Matrix<double, 3, 6> by_increment;
      by_increment << Matrix3d::Identity(), -Hat(map_from_camera.translation());
      const double position_sigma = std::sqrt((by_increment * of_inverse * by_increment.transpose()).trace());
      EXPECT_LT(CenterError(located.camera_from_map, photo.camera_from_map), 5.0 * position_sigma)
          << factor << " " << seed;
      EXPECT_LT(error.tail<3>().norm(), 5.0 * std::sqrt(covered.bottomRightCorner<3, 3>().trace()))
          << factor << " " << seed;
    }
  }
}

TEST(EstimateFocal, FindsAWrongPrincipalPoint) {
  for (const Vector2d& shift : {Vector2d(0.1, 0.0), Vector2d(-0.15, 0.05), Vector2d(0.0, -0.12)}) {
    for (std::uint64_t seed = 1; seed <= 10; ++seed) {
      const Photo photo = Take(seed);
      Pinhole wrong = kTrue;
      wrong.cx_px += 640 * shift.x();
      wrong.cy_px += 640 * shift.y();
      const auto located = RefinePose(wrong, photo.camera_from_map, photo.observations);
      ASSERT_TRUE(located.ok()) << located.status();
      const auto estimate =
          EstimateFocal(wrong, located->camera_from_map, photo.observations, {}, FocalPrior::WithPrincipalPoint());
      ASSERT_TRUE(estimate.ok()) << estimate.status();
      EXPECT_TRUE(estimate->PrincipalContradicts()) << seed;
      EXPECT_FALSE(estimate->FocalContradicts()) << seed;
      EXPECT_NEAR(estimate->principal_shift.x(), -shift.x(), 0.03);
      EXPECT_NEAR(estimate->principal_shift.y(), -shift.y(), 0.03);
      EXPECT_LT(CenterError(estimate->camera_from_map, photo.camera_from_map), 0.05);
    }
  }
}

TEST(EstimateFocal, NeedsMatches) {
  Photo photo = Take(4, 0.0);
  photo.observations.resize(10);
  EXPECT_EQ(EstimateFocal(kTrue, photo.camera_from_map, photo.observations).status().code(),
            absl::StatusCode::kFailedPrecondition);
  photo.observations[3].sigma_px = 0.0;
  EXPECT_EQ(EstimateFocal(kTrue, photo.camera_from_map, photo.observations).status().code(),
            absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::optimization
