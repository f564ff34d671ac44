#include "optimization/lens_adjustment.h"

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "base/random.h"
#include "optimization/ceres_costs.h"

namespace cairn::optimization {
namespace {

const Pinhole kPinhole{640, 480, 500.0, 510.0, 320.0, 240.0};
constexpr double kNoisePx = 0.3;

// Points in a block of 8 x 6 x 4 m before twelve cameras that move sideways and turn by up to 0.4 rad, seen through a
// lens, with noise. Poses and points are as bundle adjustment without the lens leaves them.
struct Scene {
  BundleProblem problem;
  std::vector<SE3> camera_from_map;
  std::vector<std::uint8_t> used;
};

Scene MakeScene(const LensCorrection& lens, std::uint64_t seed, bool turns = true) {
  Random random(seed);
  Scene scene;
  const Camera camera = lens.CameraOf(kPinhole);
  scene.problem.cameras = {kPinhole};
  for (int i = 0; i < 12; ++i) {
    const double turn = turns ? 0.4 * std::sin(0.7 * i) : 0.0;
    scene.camera_from_map.push_back(
        SE3(ExpSO3({0.1 * turn, turn, 0.0}), Vector3d(-0.15 * i, 0.05 * std::sin(i), 0.1 * std::cos(i))));
  }
  std::vector<Vector3d> points;
  for (int i = 0; i < 400; ++i) {
    points.emplace_back(random.Uniform(-4.0, 4.0), random.Uniform(-3.0, 3.0), random.Uniform(3.0, 7.0));
  }
  for (std::uint32_t c = 0; c < scene.camera_from_map.size(); ++c) {
    scene.problem.poses.push_back({scene.camera_from_map[c], 0, c < 1});
    for (std::uint32_t p = 0; p < points.size(); ++p) {
      const auto pixel = camera.Project(scene.camera_from_map[c] * points[p]);
      if (!pixel || !kPinhole.Contains(*pixel)) continue;
      scene.problem.observations.push_back({c, p, *pixel + kNoisePx * Vector2d(random.Normal(), random.Normal()), 1.0});
    }
  }
  scene.problem.points = points;
  scene.used.assign(scene.problem.observations.size(), 1);
  BundleAdjustmentOptions options;
  options.first_iterations = options.second_iterations = 100;
  options.chi2_threshold = 1e6;
  options.huber_threshold = 1e3;
  options.function_tolerance = 1e-9;
  const auto adjusted = AdjustBundle(scene.problem, options);
  EXPECT_TRUE(adjusted.ok()) << adjusted.status();
  for (std::size_t i = 0; i < scene.problem.poses.size(); ++i) {
    scene.problem.poses[i].camera_from_map = adjusted->camera_from_map[i];
  }
  scene.problem.points = adjusted->points;
  return scene;
}

TEST(LensAdjustmentTest, JacobiansAgreeWithDifferencesAndAutodiff) {
  Random random(5);
  const internal::LensReprojectionCost cost(kPinhole, Vector2d(300, 200), 1.7);
  for (int trial = 0; trial < 20; ++trial) {
    const SE3 pose = SE3::Exp(0.3 * Vector6d::NullaryExpr([&] { return random.Normal(); }));
    Vector3d point = pose.Inverse() * Vector3d(random.Normal(), random.Normal(), random.Uniform(1.0, 6.0));
    Vector3d lens(0.05 * random.Normal(), 0.1 * random.Normal(), 0.1 * random.Normal());
    std::array<double, 7> block;
    internal::PoseToBlock(pose, block.data());
    const auto evaluate = [&](const Vector6d& step, const Vector3d& at, const Vector3d& with) {
      std::array<double, 7> moved;
      internal::LeftIncrementManifold().Plus(block.data(), step.data(), moved.data());
      const double* parameters[] = {moved.data(), at.data(), with.data()};
      Vector2d residual;
      EXPECT_TRUE(cost.Evaluate(parameters, residual.data(), nullptr));
      return residual;
    };
    Eigen::Matrix<double, 2, 7, Eigen::RowMajor> by_pose;
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point, by_lens;
    double* jacobians[] = {by_pose.data(), by_point.data(), by_lens.data()};
    const double* parameters[] = {block.data(), point.data(), lens.data()};
    Vector2d residual;
    ASSERT_TRUE(cost.Evaluate(parameters, residual.data(), jacobians));
    constexpr double kStep = 1e-6;
    const auto check = [&](const Vector2d& plus, const Vector2d& minus, const Vector2d& analytic) {
      const Vector2d difference = (plus - minus) / (2.0 * kStep);
      EXPECT_LT((difference - analytic).norm(), 1e-4 * (1.0 + difference.norm()));
    };
    const Vector6d none = Vector6d::Zero();
    for (int i = 0; i < 6; ++i) {
      const Vector6d x = kStep * Vector6d::Unit(i);
      check(evaluate(x, point, lens), evaluate(-x, point, lens), by_pose.col(i));
    }
    for (int i = 0; i < 3; ++i) {
      const Vector3d x = kStep * Vector3d::Unit(i);
      check(evaluate(none, point + x, lens), evaluate(none, point - x, lens), by_point.col(i));
      check(evaluate(none, point, lens + x), evaluate(none, point, lens - x), by_lens.col(i));
    }
    EXPECT_EQ(by_pose.col(6), Vector2d::Zero());

    // Exp(x) ~ (I + [w], t) to first order, which is all that derivatives at x = 0 see.
    using Jet = ceres::Jet<double, 12>;
    Eigen::Matrix<Jet, 3, 1> p, t, w, l;
    for (int i = 0; i < 3; ++i) {
      t[i] = Jet(0.0, i), w[i] = Jet(0.0, 3 + i), p[i] = Jet(point[i], 6 + i), l[i] = Jet(lens[i], 9 + i);
    }
    const Eigen::Matrix<Jet, 3, 1> in_camera = pose.RotationMatrix().cast<Jet>() * p + pose.translation().cast<Jet>();
    const Eigen::Matrix<Jet, 3, 1> moved = in_camera + w.cross(in_camera) + t;
    const Jet x = moved[0] / moved[2], y = moved[1] / moved[2], r2 = x * x + y * y;
    const Jet radial = exp(l[0]) * (1.0 + r2 * (l[1] + r2 * l[2]));
    const Jet u = (kPinhole.fx_px * radial * x + kPinhole.cx_px - 300.0) / 1.7;
    const Jet v = (kPinhole.fy_px * radial * y + kPinhole.cy_px - 200.0) / 1.7;
    EXPECT_NEAR(u.a, residual[0], 1e-9);
    EXPECT_NEAR(v.a, residual[1], 1e-9);
    Eigen::Matrix<double, 2, 12> autodiff, analytic;
    autodiff << u.v.transpose(), v.v.transpose();
    analytic << by_pose.leftCols<6>(), by_point, by_lens;
    EXPECT_LT((autodiff - analytic).norm(), 1e-9 * (1.0 + analytic.norm()));
  }
}

TEST(LensAdjustmentTest, FindsTheLensAndMendsThePoses) {
  const LensCorrection truth{0.99, 0.03, -0.02};
  const Scene scene = MakeScene(truth, 1);
  const auto result = AdjustLens(scene.problem, 0, scene.used);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_NEAR(result->lens.focal_scale, truth.focal_scale, 0.003);
  EXPECT_NEAR(result->lens.k1, truth.k1, 0.006);
  EXPECT_NEAR(result->lens.k2, truth.k2, 0.012);
  EXPECT_NEAR(result->sigma_px, kNoisePx, 0.05);
  EXPECT_GT(result->gain, 1000.0);
  double before = 0.0, after = 0.0;  // of the rotations, which scale does not touch
  for (std::size_t i = 0; i < scene.camera_from_map.size(); ++i) {
    const SE3 truth_from_map = scene.camera_from_map[i];
    before += AngleRad((truth_from_map * scene.problem.poses[i].camera_from_map.Inverse()).rotation());
    after += AngleRad((truth_from_map * result->camera_from_map[i].Inverse()).rotation());
  }
  EXPECT_LT(after, 0.5 * before);
}

TEST(LensAdjustmentTest, ARightCalibrationGainsNothing) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
    const Scene scene = MakeScene({}, seed);
    const auto result = AdjustLens(scene.problem, 0, scene.used);
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_LT(result->gain, 16.3) << "chi-square of three degrees of freedom, 99.9 %";
    EXPECT_LT(result->lens.ShiftOver(kPinhole).rms_px, 0.6);
  }
}

TEST(LensAdjustmentTest, WhatTheViewsLeaveOpenStaysAtThePrior) {
  // Two views sideways of a scene tell little of the focal length.
  Scene scene = MakeScene({}, 7, /*turns=*/false);
  for (std::size_t i = 0; i < scene.used.size(); ++i) scene.used[i] = scene.problem.observations[i].pose < 2;
  const auto result = AdjustLens(scene.problem, 0, scene.used);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_LT(std::abs(std::log(result->lens.focal_scale)), 0.06);
  EXPECT_LT(std::abs(result->lens.k1), 0.15);
}

TEST(LensAdjustmentTest, BadInputIsRefused) {
  const Scene scene = MakeScene({}, 2);
  EXPECT_EQ(AdjustLens(scene.problem, 1, scene.used).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(AdjustLens(scene.problem, 0, {}).status().code(), absl::StatusCode::kInvalidArgument);
  LensAdjustmentOptions options;
  options.k1_sigma = 0.0;
  EXPECT_EQ(AdjustLens(scene.problem, 0, scene.used, options).status().code(), absl::StatusCode::kInvalidArgument);
  const std::vector<std::uint8_t> none(scene.used.size(), 0);
  EXPECT_EQ(AdjustLens(scene.problem, 0, none).status().code(), absl::StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace cairn::optimization
