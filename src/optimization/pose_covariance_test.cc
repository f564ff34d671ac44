#include "optimization/pose_covariance.h"

#include <gtest/gtest.h>

#include <cmath>

#include "base/random.h"
#include "geometry/alignment.h"

namespace cairn::optimization {
namespace {

const Pinhole kPinhole{640, 480, 500.0, 500.0, 320.0, 240.0};
constexpr double kNoisePx = 0.4;
constexpr int kViews = 8;

// Cameras on an arc before a block of points, without noise.
BundleProblem Exact() {
  Random random(7);
  BundleProblem problem;
  problem.cameras = {kPinhole};
  for (int i = 0; i < 150; ++i) {
    problem.points.emplace_back(random.Uniform(-3.0, 3.0), random.Uniform(-2.0, 2.0), random.Uniform(3.0, 6.0));
  }
  for (std::uint32_t c = 0; c < kViews; ++c) {
    const double a = 0.15 * c;
    problem.poses.push_back(
        {SE3(ExpSO3({0.0, 0.3 * a, 0.0}), Vector3d(-a, 0.2 * std::sin(3.0 * a), 0.1 * a)), 0, false});
    for (std::uint32_t p = 0; p < problem.points.size(); ++p) {
      const Vector3d point_c = problem.poses.back().camera_from_map * problem.points[p];
      const Vector2d pixel = kPinhole.Project(point_c);
      if (kPinhole.Contains(pixel)) problem.observations.push_back({c, p, pixel, 1.0});
    }
  }
  return problem;
}

std::vector<Vector3d> Centres(const std::vector<SE3>& camera_from_map) {
  std::vector<Vector3d> centres;
  for (const SE3& pose : camera_from_map) centres.push_back(pose.Inverse().translation());
  return centres;
}

struct Trial {
  BundleProblem problem;  // adjusted
  std::vector<SE3> camera_from_map;
};

Trial Adjusted(BundleProblem problem, std::uint64_t seed) {
  Random random(seed);
  for (BundleObservation& o : problem.observations) o.pixel += kNoisePx * Vector2d(random.Normal(), random.Normal());
  const bool holds_first = problem.poses.front().fixed;
  problem.poses.front().fixed = true;
  BundleAdjustmentOptions options;
  options.first_iterations = 50;
  options.second_iterations = 0;
  options.huber_threshold = 100.0;
  options.function_tolerance = 1e-12;
  const auto result = AdjustBundle(problem, options);
  EXPECT_TRUE(result.ok()) << result.status();
  for (std::size_t i = 0; i < problem.poses.size(); ++i) problem.poses[i].camera_from_map = result->camera_from_map[i];
  problem.points = result->points;
  problem.poses.front().fixed = holds_first;
  return {problem, result->camera_from_map};
}

// The claimed sigmas are those that many trials with new noise show, after the best similarity.
TEST(PoseCovariance, IsWhatTrialsShow) {
  const BundleProblem exact = Exact();
  std::vector<SE3> truth;
  for (const BundlePose& pose : exact.poses) truth.push_back(pose.camera_from_map);
  std::vector<double> position(kViews, 0.0), rotation(kViews, 0.0);
  PoseUncertainty claimed;
  constexpr int kTrials = 60;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Trial adjusted = Adjusted(exact, 100 + static_cast<std::uint64_t>(trial));
    const auto aligned = AlignPoints(Centres(truth), Centres(adjusted.camera_from_map));
    ASSERT_TRUE(aligned.ok());
    for (std::size_t i = 0; i < kViews; ++i) {
      const SE3 pose = aligned->a_from_b.TransformPose(adjusted.camera_from_map[i].Inverse());
      position[i] += (pose.translation() - truth[i].Inverse().translation()).squaredNorm() / (3.0 * kTrials);
      const double turned = AngleRad(pose.rotation() * truth[i].rotation());
      rotation[i] += turned * turned / (3.0 * kTrials);
    }
    if (trial > 0) continue;
    const std::vector<std::uint8_t> used(adjusted.problem.observations.size(), 1);
    const auto uncertainty = UncertaintyOfPoses(adjusted.problem, used);
    ASSERT_TRUE(uncertainty.ok()) << uncertainty.status();
    claimed = *uncertainty;
  }
  EXPECT_NEAR(claimed.noise_px, kNoisePx, 0.05);
  for (std::size_t i = 0; i < kViews; ++i) {
    EXPECT_NEAR(std::sqrt(position[i]) / claimed.poses[i].position, 1.0, 0.3) << i;
    EXPECT_NEAR(std::sqrt(rotation[i]) / claimed.poses[i].rotation_rad, 1.0, 0.3) << i;
  }
}

TEST(PoseCovariance, HeldPosesAreExactAndTheOthersAreMeasuredFromThem) {
  BundleProblem problem = Exact();
  problem.poses[0].fixed = problem.poses[1].fixed = true;
  const Trial adjusted = Adjusted(problem, 5);
  const std::vector<std::uint8_t> used(adjusted.problem.observations.size(), 1);
  const auto uncertainty = UncertaintyOfPoses(adjusted.problem, used);
  ASSERT_TRUE(uncertainty.ok()) << uncertainty.status();
  EXPECT_EQ(uncertainty->poses[0].position, 0.0);
  EXPECT_EQ(uncertainty->poses[1].position, 0.0);
  EXPECT_GT(uncertainty->poses[7].position, 1.3 * uncertainty->poses[2].position);
}

TEST(PoseCovariance, SaysWhatItCannotTell) {
  const BundleProblem problem = Exact();
  const std::vector<std::uint8_t> all(problem.observations.size(), 1), none(problem.observations.size(), 0);
  EXPECT_TRUE(absl::IsFailedPrecondition(UncertaintyOfPoses(problem, none).status()));
  EXPECT_TRUE(absl::IsFailedPrecondition(UncertaintyOfPoses(problem, all, kViews - 1).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(UncertaintyOfPoses(problem, {}).status()));
}

}  // namespace
}  // namespace cairn::optimization
