#include "optimization/bundle_adjustment.h"

#include <ceres/jet.h>
#include <ceres/rotation.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "base/random.h"
#include "optimization/ceres_costs.h"

namespace cairn::optimization {
namespace {

const Pinhole kPinhole{640, 480, 525.0, 520.0, 320.0, 240.0};

Vector6d RandomTangent(Random& random, double translation, double rotation) {
  Vector6d x;
  for (int i = 0; i < 6; ++i) x[i] = random.Normal() * (i < 3 ? translation : rotation);
  return x;
}

// Residuals at Exp(x) pose (and point + d), through the manifold.
Vector2d Residual(const ceres::CostFunction& cost, const SE3& pose, const Vector6d& x, const Vector3d& point) {
  std::array<double, 7> block, moved;
  internal::PoseToBlock(pose, block.data());
  internal::LeftIncrementManifold().Plus(block.data(), x.data(), moved.data());
  const double* parameters[] = {moved.data(), point.data()};
  Vector2d residual;
  EXPECT_TRUE(cost.Evaluate(parameters, residual.data(), nullptr));
  return residual;
}

TEST(CeresCosts, ReprojectionJacobiansAgreeWithDifferencesAndAutodiff) {
  Random random(3);
  for (int trial = 0; trial < 20; ++trial) {
    const SE3 pose = SE3::Exp(RandomTangent(random, 0.5, 0.5));
    const Vector3d point = pose.Inverse() * Vector3d(random.Normal(), random.Normal(), random.Uniform(1.0, 6.0));
    const internal::ReprojectionCost cost(kPinhole, Vector2d(300, 200), 1.7);
    std::array<double, 7> block;
    internal::PoseToBlock(pose, block.data());
    const double* parameters[] = {block.data(), point.data()};
    Vector2d residual;
    Eigen::Matrix<double, 2, 7, Eigen::RowMajor> by_pose;
    Eigen::Matrix<double, 2, 3, Eigen::RowMajor> by_point;
    double* jacobians[] = {by_pose.data(), by_point.data()};
    ASSERT_TRUE(cost.Evaluate(parameters, residual.data(), jacobians));

    constexpr double kStep = 1e-6;
    for (int i = 0; i < 6; ++i) {
      const Vector6d x = Vector6d::Unit(i) * kStep;
      const Vector2d difference = (Residual(cost, pose, x, point) - Residual(cost, pose, -x, point)) / (2 * kStep);
      EXPECT_LT((difference - by_pose.col(i)).norm(), 1e-4 * (1.0 + difference.norm()));
    }
    EXPECT_EQ(by_pose.col(6), Vector2d::Zero());
    for (int i = 0; i < 3; ++i) {
      const Vector3d x = Vector3d::Unit(i) * kStep;
      const Vector2d difference =
          (Residual(cost, pose, Vector6d::Zero(), point + x) - Residual(cost, pose, Vector6d::Zero(), point - x)) /
          (2 * kStep);
      EXPECT_LT((difference - by_point.col(i)).norm(), 1e-4 * (1.0 + difference.norm()));
    }

    // Exp(x) ~ (I + [w], t) to first order, which is all that derivatives at x = 0 see.
    using Jet = ceres::Jet<double, 9>;
    Eigen::Matrix<Jet, 3, 1> p;
    for (int i = 0; i < 3; ++i) p[i] = Jet(point[i], 6 + i);
    const Eigen::Matrix<Jet, 3, 1> in_camera = pose.RotationMatrix().cast<Jet>() * p + pose.translation().cast<Jet>();
    const Eigen::Matrix<Jet, 3, 1> t(Jet(0.0, 0), Jet(0.0, 1), Jet(0.0, 2)), w(Jet(0.0, 3), Jet(0.0, 4), Jet(0.0, 5));
    const Eigen::Matrix<Jet, 3, 1> moved = in_camera + w.cross(in_camera) + t;
    const Jet u = (kPinhole.fx_px * moved[0] / moved[2] + kPinhole.cx_px - 300.0) / 1.7;
    const Jet v = (kPinhole.fy_px * moved[1] / moved[2] + kPinhole.cy_px - 200.0) / 1.7;
    EXPECT_NEAR(u.a, residual[0], 1e-9);
    EXPECT_NEAR(v.a, residual[1], 1e-9);
    Eigen::Matrix<double, 2, 9> autodiff, analytic;
    autodiff << u.v.transpose(), v.v.transpose();
    analytic << by_pose.leftCols<6>(), by_point;
    EXPECT_LT((autodiff - analytic).norm(), 1e-9 * (1.0 + analytic.norm()));
  }
}

TEST(CeresCosts, ReprojectionFailsBehindTheCamera) {
  const internal::ReprojectionCost cost(kPinhole, Vector2d(300, 200), 1.0);
  std::array<double, 7> block;
  internal::PoseToBlock(SE3(), block.data());
  const Vector3d point(0, 0, -1);
  const double* parameters[] = {block.data(), point.data()};
  Vector2d residual;
  EXPECT_FALSE(cost.Evaluate(parameters, residual.data(), nullptr));
}

TEST(CeresCosts, PriorJacobianAgreesWithDifferencesAndAutodiff) {
  Random random(4);
  const internal::LeftIncrementManifold manifold;
  for (int trial = 0; trial < 20; ++trial) {
    const SE3 prior = SE3::Exp(RandomTangent(random, 1.0, 0.5));
    const SE3 pose = SE3::Exp(RandomTangent(random, 0.3, 0.3)) * prior;
    const internal::PosePriorCost cost(prior, 0.02, 0.01);
    std::array<double, 7> block, moved;
    internal::PoseToBlock(pose, block.data());
    Vector6d residual, high, low;
    Eigen::Matrix<double, 6, 7, Eigen::RowMajor> jacobian;
    const double* at[] = {block.data()};
    double* jacobians[] = {jacobian.data()};
    ASSERT_TRUE(cost.Evaluate(at, residual.data(), jacobians));
    for (int i = 0; i < 6; ++i) {
      const Vector6d x = Vector6d::Unit(i) * 1e-6;
      const double* there[] = {moved.data()};
      manifold.Plus(block.data(), x.data(), moved.data());
      cost.Evaluate(there, high.data(), nullptr);
      const Vector6d back = -x;
      manifold.Plus(block.data(), back.data(), moved.data());
      cost.Evaluate(there, low.data(), nullptr);
      const Vector6d difference = (high - low) / 2e-6;
      EXPECT_LT((difference - jacobian.col(i)).norm(), 1e-5 * (1.0 + difference.norm()));
    }

    using Jet = ceres::Jet<double, 6>;
    using Vector3j = Eigen::Matrix<Jet, 3, 1>;
    const Vector3j t(Jet(0.0, 0), Jet(0.0, 1), Jet(0.0, 2)), w(Jet(0.0, 3), Jet(0.0, 4), Jet(0.0, 5));
    // To first order: R' = (I + [w]) R, and so R'^T v = R^T (v - w x v).
    const Vector3j origin = pose.translation().cast<Jet>() + w.cross(Vector3j(pose.translation().cast<Jet>())) + t;
    const Vector3j centre = -(pose.RotationMatrix().transpose().cast<Jet>() * Vector3j(origin - w.cross(origin)));
    const Quaterniond error = pose.rotation() * prior.rotation().conjugate();
    const Jet step[] = {Jet(1.0), 0.5 * w[0], 0.5 * w[1], 0.5 * w[2]};
    const Jet from[] = {Jet(error.w()), Jet(error.x()), Jet(error.y()), Jet(error.z())};
    Jet turned[4], angle_axis[3];
    ceres::QuaternionProduct(step, from, turned);
    ceres::QuaternionToAngleAxis(turned, angle_axis);
    const Vector3d prior_centre = prior.Inverse().translation();
    for (int i = 0; i < 3; ++i) {
      const Jet shift = (centre[i] - prior_centre[i]) / 0.02, turn = angle_axis[i] / 0.01;
      EXPECT_NEAR(shift.a, residual[i], 1e-9);
      EXPECT_NEAR(turn.a, residual[3 + i], 1e-9);
      EXPECT_LT((shift.v.transpose() - jacobian.row(i).head<6>()).norm(), 1e-9 * (1.0 + shift.v.norm()));
      EXPECT_LT((turn.v.transpose() - jacobian.row(3 + i).head<6>()).norm(), 1e-9 * (1.0 + turn.v.norm()));
    }
  }
}

TEST(CeresCosts, ManifoldMinusUndoesPlus) {
  Random random(5);
  const internal::LeftIncrementManifold manifold;
  std::array<double, 7> x, y;
  internal::PoseToBlock(SE3::Exp(RandomTangent(random, 1.0, 1.0)), x.data());
  const Vector6d delta = RandomTangent(random, 0.5, 0.5);
  Vector6d back;
  manifold.Plus(x.data(), delta.data(), y.data());
  manifold.Minus(y.data(), x.data(), back.data());
  EXPECT_LT((back - delta).norm(), 1e-12);
}

struct World {
  BundleProblem truth, start;
};

// Cameras on an arc that look at a cloud; the first two are fixed and right, the rest and all points are disturbed.
World MakeWorld(std::uint64_t seed, double noise_px, int num_poses = 8, int num_points = 150) {
  Random random(seed);
  World world;
  BundleProblem& truth = world.truth;
  truth.cameras = {kPinhole};
  for (int i = 0; i < num_poses; ++i) {
    const double angle = 0.06 * i;
    const SE3 camera_from_map(ExpSO3(Vector3d(0, angle, 0)), Vector3d(-0.25 * i, 0.02 * i, 0.0));
    truth.poses.push_back({camera_from_map, 0, i < 2});
  }
  for (int i = 0; i < num_points; ++i) {
    truth.points.push_back({random.Uniform(-2, 2), random.Uniform(-1.5, 1.5), random.Uniform(3, 6)});
  }
  for (std::uint32_t k = 0; k < truth.poses.size(); ++k) {
    for (std::uint32_t p = 0; p < truth.points.size(); ++p) {
      const Vector3d in_camera = truth.poses[k].camera_from_map * truth.points[p];
      const Vector2d pixel = kPinhole.Project(in_camera);
      if (!kPinhole.Contains(pixel)) continue;
      const double sigma = std::pow(1.2, static_cast<double>(random.Below(4)));
      truth.observations.push_back(
          {k, p, pixel + noise_px * sigma * Vector2d(random.Normal(), random.Normal()), sigma});
    }
  }
  world.start = truth;
  for (BundlePose& pose : world.start.poses) {
    if (!pose.fixed) pose.camera_from_map = SE3::Exp(RandomTangent(random, 0.02, 0.01)) * pose.camera_from_map;
  }
  for (Vector3d& point : world.start.points)
    point += 0.05 * Vector3d(random.Normal(), random.Normal(), random.Normal());
  return world;
}

double PoseError(const World& world, const BundleResult& result) {
  double worst = 0.0;
  for (std::size_t i = 0; i < result.camera_from_map.size(); ++i) {
    const SE3 error = result.camera_from_map[i] * world.truth.poses[i].camera_from_map.Inverse();
    worst = std::max(worst, error.Log().norm());
  }
  return worst;
}

TEST(BundleAdjustment, FindsTheExactAnswer) {
  for (const int max_dense_poses : {60, 0}) {  // dense and sparse solver
    const World world = MakeWorld(1, 0.0);
    BundleAdjustmentOptions options;
    options.first_iterations = 20;
    options.function_tolerance = 1e-14;
    options.max_dense_poses = max_dense_poses;
    const auto result = AdjustBundle(world.start, options);
    ASSERT_TRUE(result.ok()) << result.status();
    EXPECT_LT(PoseError(world, *result), 1e-7);
    std::vector<int> views(result->points.size(), 0);
    for (const BundleObservation& observation : world.start.observations) ++views[observation.point];
    for (std::size_t i = 0; i < result->points.size(); ++i) {
      if (views[i] < 2) continue;
      EXPECT_LT((result->points[i] - world.truth.points[i]).norm(), 1e-6);
    }
    EXPECT_GE(result->num_inliers, 0.99 * static_cast<double>(world.truth.observations.size()));
    EXPECT_EQ(result->camera_from_map[0].Matrix(), world.truth.poses[0].camera_from_map.Matrix()) << "fixed";
  }
}

// Rotations of a world's poses one to the next, with errors of `sigma_rad` per axis.
void AddRotations(double sigma_rad, std::uint64_t seed, World* world) {
  Random random(seed);
  for (std::uint32_t i = 0; i + 1 < world->truth.poses.size(); ++i) {
    const Vector3d error = sigma_rad * Vector3d(random.Normal(), random.Normal(), random.Normal());
    const Quaterniond b_from_a = world->truth.poses[i + 1].camera_from_map.rotation() *
                                 world->truth.poses[i].camera_from_map.rotation().conjugate();
    world->start.rotations.push_back({i, i + 1, ExpSO3(error) * b_from_a, 1.0});
  }
}

TEST(BundleAdjustment, DenseAndSparseSolversAgree) {
  World world = MakeWorld(7, 0.7, 12, 200);
  for (std::size_t i = 0; i < world.start.observations.size(); i += 15) {
    world.start.observations[i].pixel += Vector2d(25.0, -10.0);
  }
  world.start.priors.push_back({5, world.truth.poses[5].camera_from_map, 0.05, 0.02});
  AddRotations(0.002, 4, &world);
  BundleAdjustmentOptions options;
  options.first_iterations = options.second_iterations = options.noise_iterations = 50;
  options.function_tolerance = 1e-13;
  const auto dense = AdjustBundle(world.start, options);
  options.max_dense_poses = 0;
  const auto sparse = AdjustBundle(world.start, options);
  ASSERT_TRUE(dense.ok() && sparse.ok());
  EXPECT_NEAR(dense->initial_cost, sparse->initial_cost, 1e-6 * sparse->initial_cost);
  EXPECT_NEAR(dense->final_cost, sparse->final_cost, 1e-6 * sparse->final_cost);
  EXPECT_EQ(dense->inlier, sparse->inlier);
  for (std::size_t i = 0; i < world.start.poses.size(); ++i) {
    const SE3 difference = dense->camera_from_map[i] * sparse->camera_from_map[i].Inverse();
    EXPECT_LT(difference.Log().norm(), 1e-5) << i;
  }
}

TEST(CeresCosts, RotationJacobianAgreesWithDifferencesAndAutodiff) {
  Random random(8);
  const internal::LeftIncrementManifold manifold;
  for (int trial = 0; trial < 20; ++trial) {
    const SE3 poses[2] = {SE3::Exp(RandomTangent(random, 1.0, 0.5)), SE3::Exp(RandomTangent(random, 1.0, 0.5))};
    const Quaterniond measured =
        SE3::Exp(RandomTangent(random, 1.0, 0.2)).rotation() * poses[1].rotation() * poses[0].rotation().conjugate();
    const internal::RelativeRotationCost cost(measured, 0.01);
    std::array<double, 7> blocks[2];
    for (int k = 0; k < 2; ++k) internal::PoseToBlock(poses[k], blocks[k].data());
    const double* at[] = {blocks[0].data(), blocks[1].data()};
    Vector3d residual, high, low;
    Eigen::Matrix<double, 3, 7, Eigen::RowMajor> jacobian[2];
    double* jacobians[] = {jacobian[0].data(), jacobian[1].data()};
    ASSERT_TRUE(cost.Evaluate(at, residual.data(), jacobians));
    for (int k = 0; k < 2; ++k) {
      for (int i = 0; i < 6; ++i) {
        std::array<double, 7> moved;
        const double* there[] = {at[0], at[1]};
        there[k] = moved.data();
        const Vector6d x = Vector6d::Unit(i) * 1e-6, back = -x;
        manifold.Plus(at[k], x.data(), moved.data());
        cost.Evaluate(there, high.data(), nullptr);
        manifold.Plus(at[k], back.data(), moved.data());
        cost.Evaluate(there, low.data(), nullptr);
        const Vector3d difference = (high - low) / 2e-6;
        EXPECT_LT((difference - jacobian[k].col(i)).norm(), 1e-5 * (1.0 + difference.norm()));
      }
    }

    // q_b q_a^-1 q^-1 with q' = (1, w / 2) q for both, to first order.
    using Jet = ceres::Jet<double, 6>;
    const auto stepped = [](const Quaterniond& q, int first, Jet* out) {
      const Jet step[] = {Jet(1.0), 0.5 * Jet(0.0, first), 0.5 * Jet(0.0, first + 1), 0.5 * Jet(0.0, first + 2)};
      const Jet from[] = {Jet(q.w()), Jet(q.x()), Jet(q.y()), Jet(q.z())};
      ceres::QuaternionProduct(step, from, out);
    };
    Jet a[4], b[4], b_from_a[4], error[4], angle_axis[3];
    stepped(poses[0].rotation(), 0, a);
    stepped(poses[1].rotation(), 3, b);
    const Jet a_inverse[] = {a[0], -a[1], -a[2], -a[3]};
    ceres::QuaternionProduct(b, a_inverse, b_from_a);
    const Jet measured_inverse[] = {Jet(measured.w()), Jet(-measured.x()), Jet(-measured.y()), Jet(-measured.z())};
    ceres::QuaternionProduct(b_from_a, measured_inverse, error);
    ceres::QuaternionToAngleAxis(error, angle_axis);
    for (int i = 0; i < 3; ++i) {
      const Jet turn = angle_axis[i] / 0.01;
      EXPECT_NEAR(turn.a, residual[i], 1e-9);
      EXPECT_LT((turn.v.head<3>().transpose() - jacobian[0].row(i).segment<3>(3)).norm(), 1e-9 * (1.0 + turn.v.norm()));
      EXPECT_LT((turn.v.tail<3>().transpose() - jacobian[1].row(i).segment<3>(3)).norm(), 1e-9 * (1.0 + turn.v.norm()));
    }
  }
}

// Wrong by less than the chi-square threshold sees, many times the noise: as at corners that are not quite the same.
void Spoil(World* world) {
  Random random(12);
  for (std::size_t i = 0; i < world->start.observations.size(); i += 5) {
    const double angle = random.Uniform(0, 6.28);
    world->start.observations[i].pixel +=
        1.8 * world->start.observations[i].sigma_px * Vector2d(std::cos(angle), std::sin(angle));
  }
}

TEST(BundleAdjustment, TheMeasuredNoiseMakesSmallErrorsCountLess) {
  World world = MakeWorld(2, 0.1);
  Spoil(&world);
  BundleAdjustmentOptions options;
  options.first_iterations = options.second_iterations = 30;
  options.function_tolerance = 1e-9;
  const auto by_sigma = AdjustBundle(world.start, options);
  options.noise_iterations = 30;
  const auto by_noise = AdjustBundle(world.start, options);
  ASSERT_TRUE(by_sigma.ok() && by_noise.ok());
  EXPECT_EQ(by_sigma->noise_px, 0.0);
  EXPECT_GT(by_noise->noise_px, 0.08);
  EXPECT_LT(by_noise->noise_px, 0.3);
  EXPECT_EQ(by_noise->rotation_noise_rad, 0.0);
  EXPECT_LT(PoseError(world, *by_noise), 0.6 * PoseError(world, *by_sigma));
}

double RotationError(const World& world, const BundleResult& result) {
  double sum = 0.0;
  for (std::size_t i = 0; i < result.camera_from_map.size(); ++i) {
    const Quaterniond& truth = world.truth.poses[i].camera_from_map.rotation();
    sum += std::pow(AngleRad(result.camera_from_map[i].rotation() * truth.conjugate()), 2);
  }
  return std::sqrt(sum / static_cast<double>(result.camera_from_map.size()));
}

TEST(BundleAdjustment, RotationsFromElsewhereAreWeightedByHowTheyDisagree) {
  for (const int max_dense_poses : {60, 0}) {
    BundleAdjustmentOptions options;
    options.first_iterations = options.second_iterations = options.noise_iterations = 30;
    options.function_tolerance = 1e-9;
    options.max_dense_poses = max_dense_poses;
    World plain = MakeWorld(2, 0.7, 24, 120), good = plain, bad = plain;
    AddRotations(1e-5, 3, &good);
    AddRotations(0.1, 3, &bad);
    // A few that are altogether wrong do no harm.
    good.start.rotations[4].b_from_a = ExpSO3(Vector3d(0.2, 0.1, -0.3)) * good.start.rotations[4].b_from_a;
    const auto without = AdjustBundle(plain.start, options), with_good = AdjustBundle(good.start, options),
               with_bad = AdjustBundle(bad.start, options);
    ASSERT_TRUE(without.ok() && with_good.ok() && with_bad.ok());
    EXPECT_GT(with_good->rotation_noise_rad, 0.0);
    EXPECT_LT(with_good->rotation_noise_rad, 0.01);
    EXPECT_GT(with_bad->rotation_noise_rad, 0.08);
    EXPECT_LT(RotationError(plain, *with_good), 0.85 * RotationError(plain, *without)) << max_dense_poses;
    EXPECT_LT(RotationError(plain, *with_bad), 1.05 * RotationError(plain, *without)) << max_dense_poses;
  }
}

TEST(BundleAdjustment, RejectsOutliersAndStaysAccurate) {
  World world = MakeWorld(2, 0.5);
  Random random(9);
  std::vector<std::uint8_t> spoiled(world.start.observations.size(), 0);
  for (std::size_t i = 0; i < spoiled.size(); i += 10) {
    spoiled[i] = 1;
    const double angle = random.Uniform(0, 6.28);
    world.start.observations[i].pixel += 40.0 * Vector2d(std::cos(angle), std::sin(angle));
  }
  const auto result = AdjustBundle(world.start);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_LT(PoseError(world, *result), 0.01);
  int missed = 0, wrong = 0;
  for (std::size_t i = 0; i < spoiled.size(); ++i) {
    missed += spoiled[i] && result->inlier[i];
    wrong += !spoiled[i] && !result->inlier[i];
  }
  EXPECT_LE(missed, 1);
  EXPECT_LT(wrong, 0.02 * static_cast<double>(spoiled.size()));
  EXPECT_LT(result->inlier_rmse, 0.8);
  EXPECT_GT(result->initial_cost, result->final_cost);
}

TEST(BundleAdjustment, IsDeterministic) {
  const World world = MakeWorld(3, 0.5);
  const auto a = AdjustBundle(world.start), b = AdjustBundle(world.start);
  ASSERT_TRUE(a.ok() && b.ok());
  for (std::size_t i = 0; i < a->points.size(); ++i) EXPECT_EQ(a->points[i], b->points[i]);
}

TEST(BundleAdjustment, StopsWhenAsked) {
  const World world = MakeWorld(3, 0.5);
  std::atomic<bool> stop = true;
  BundleAdjustmentOptions options;
  options.stop = &stop;
  const auto stopped = AdjustBundle(world.start, options);
  ASSERT_TRUE(stopped.ok()) << stopped.status();
  EXPECT_TRUE(stopped->interrupted);
  EXPECT_LE(stopped->iterations, 1);
  EXPECT_EQ(stopped->camera_from_map.size(), world.start.poses.size());
  stop = false;
  const auto whole = AdjustBundle(world.start, options);
  ASSERT_TRUE(whole.ok()) << whole.status();
  EXPECT_FALSE(whole->interrupted);
  EXPECT_GT(whole->iterations, 1);
}

TEST(BundleAdjustment, PriorsHoldThePoses) {
  World world = MakeWorld(4, 0.3);
  for (std::uint32_t i = 0; i < world.start.poses.size(); ++i) {
    world.start.poses[i].fixed = false;
    world.start.priors.push_back({i, world.truth.poses[i].camera_from_map, 0.005, 0.002});
  }
  const auto result = AdjustBundle(world.start);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_LT(PoseError(world, *result), 0.01);
}

TEST(BundleAdjustment, LeavesPointsWithOneRayAlone) {
  World world = MakeWorld(5, 0.0);
  world.start.points.push_back({0.1, 0.2, 4.0});
  const auto lone = static_cast<std::uint32_t>(world.start.points.size() - 1);
  world.start.observations.push_back({3, lone, Vector2d(100, 100), 1.0});
  world.start.points.push_back({0.0, 0.0, -3.0});  // behind both of its cameras
  world.start.observations.push_back({2, lone + 1, Vector2d(100, 100), 1.0});
  world.start.observations.push_back({3, lone + 1, Vector2d(100, 100), 1.0});
  const auto result = AdjustBundle(world.start);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_EQ(result->points[lone], world.start.points[lone]);
  EXPECT_EQ(result->points[lone + 1], world.start.points[lone + 1]);
  EXPECT_EQ(result->inlier.back(), 0);
}

TEST(BundleAdjustment, RefusesBadInput) {
  const World good = MakeWorld(6, 0.0);
  const auto code = [](const BundleProblem& problem, const BundleAdjustmentOptions& options = {}) {
    return AdjustBundle(problem, options).status().code();
  };
  BundleProblem bad = good.start;
  bad.observations[0].point = 1000000;
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  bad = good.start;
  bad.observations[0].sigma_px = 0.0;
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  bad = good.start;
  bad.points[0].x() = std::nan("");
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  bad = good.start;
  bad.poses[0].camera = 1;
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  bad = good.start;
  bad.priors.push_back({0, SE3(), 0.0, 1.0});
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  bad = good.start;
  bad.rotations.push_back({2, 2, Quaterniond::Identity(), 1.0});
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  bad.rotations[0] = {2, 3, Quaterniond::Identity(), 0.0};
  EXPECT_EQ(code(bad), absl::StatusCode::kInvalidArgument);
  bad = good.start;
  for (BundlePose& pose : bad.poses) pose.fixed = false;
  EXPECT_EQ(code(bad), absl::StatusCode::kFailedPrecondition);
  EXPECT_EQ(code(BundleProblem{}), absl::StatusCode::kFailedPrecondition);
  BundleAdjustmentOptions options;
  options.first_iterations = 0;
  EXPECT_EQ(code(good.start, options), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::optimization
