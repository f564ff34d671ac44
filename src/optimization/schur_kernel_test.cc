// The Schur kernels of every instruction set against the same sums by Eigen and reprojection.h.
#include "optimization/schur_kernel.h"

#include <gtest/gtest.h>

#include <vector>

#include "base/cpu_features.h"
#include "base/random.h"
#include "optimization/reprojection.h"

namespace cairn::optimization::internal {
namespace {

using Matrix63d = Eigen::Matrix<double, 6, 3>;

struct World {
  Pinhole pinhole{640, 480, 500.0, 510.0, 319.0, 241.0};
  std::vector<SE3> poses;
  std::vector<SchurCamera> cameras;
  std::vector<SchurSight> sights;
  int free_count = 0;
  Vector3d position;
  SchurPoint point() const { return {sights.data(), static_cast<int>(sights.size()), free_count}; }
};

World MakeWorld(Random* random) {
  World world;
  const auto vector = [&](double size) {
    return Vector3d(random->Uniform(-size, size), random->Uniform(-size, size), random->Uniform(-size, size));
  };
  world.position = Vector3d(0.3, -0.2, 4.0) + vector(0.5);
  const std::vector<std::int32_t> free = {0, 2, 3, -1, -1};
  for (std::uint32_t i = 0; i < free.size(); ++i) {
    Vector6d twist;
    twist << vector(0.3), vector(0.1);
    world.poses.push_back(SE3::Exp(twist));
    SchurCamera& camera = world.cameras.emplace_back();
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(camera.rotation) = world.poses[i].RotationMatrix();
    Eigen::Map<Vector3d>(camera.translation) = world.poses[i].translation();
    camera.fx = world.pinhole.fx_px, camera.fy = world.pinhole.fy_px;
    camera.cx = world.pinhole.cx_px, camera.cy = world.pinhole.cy_px;
    // Some beyond the threshold of the robust loss, some not.
    const Vector2d pixel = world.pinhole.Project(world.poses[i] * world.position) + vector(i % 2 ? 1.0 : 8.0).head<2>();
    world.sights.push_back({i, free[i], pixel.x(), pixel.y(), random->Uniform(0.3, 1.0)});
    world.free_count += free[i] >= 0 ? 1 : 0;
  }
  return world;
}

constexpr std::size_t kFree = 4;

// What the kernels compute, padded as they do.
struct Sums {
  std::vector<double> pose_hessian = std::vector<double>(kFree * kPoseBlock, 0.0);
  std::vector<double> pose_gradient = std::vector<double>(kFree * kPadded, 0.0);
  std::vector<double> cross;
  std::vector<double> reduced = std::vector<double>(kFree * (kFree + 1) / 2 * kPoseBlock, 0.0);
  std::vector<double> right = std::vector<double>(kFree * kPadded, 0.0);
  Matrix3d point_hessian = Matrix3d::Zero();
  Vector3d point_gradient = Vector3d::Zero();
};

template <int kColumns>
void Add(const Eigen::Matrix<double, 6, kColumns>& block, double* to) {
  for (int c = 0; c < kColumns; ++c) {
    for (int r = 0; r < 6; ++r) to[c * kPadded + r] += block(r, c);
  }
}

Sums Expected(const World& world, double huber) {
  Sums sums;
  sums.cross.assign(world.sights.size() * kCrossBlock, 0.0);
  std::vector<Matrix63d> cross;
  for (std::size_t i = 0; i < world.sights.size(); ++i) {
    const SchurSight& sight = world.sights[i];
    const SE3& pose = world.poses[sight.pose];
    const Vector3d point_c = pose * world.position;
    const Vector2d residual = ReprojectionResidual(world.pinhole, point_c, {sight.u, sight.v});
    double weight = sight.weight * sight.weight;
    if (huber > 0.0) weight *= HuberLoss{huber}.Weight(weight * residual.squaredNorm());
    const Matrix23d by_point = ReprojectionByPoint(world.pinhole, pose.RotationMatrix(), point_c);
    sums.point_hessian += weight * by_point.transpose() * by_point;
    sums.point_gradient += weight * by_point.transpose() * residual;
    if (sight.free < 0) continue;
    const Matrix26d by_pose = ReprojectionByPose(world.pinhole, point_c);
    Add<6>(weight * by_pose.transpose() * by_pose, &sums.pose_hessian[sight.free * kPoseBlock]);
    Add<1>(weight * by_pose.transpose() * residual, &sums.pose_gradient[sight.free * kPadded]);
    cross.push_back(weight * by_pose.transpose() * by_point);
    Add<3>(cross.back(), &sums.cross[i * kCrossBlock]);
  }
  const Matrix3d inverse = sums.point_hessian.inverse();
  for (std::size_t i = 0; i < cross.size(); ++i) {
    const auto row = static_cast<std::size_t>(world.sights[i].free);
    Add<1>(cross[i] * inverse * sums.point_gradient, &sums.right[row * kPadded]);
    for (std::size_t j = 0; j <= i; ++j) {
      const auto column = static_cast<std::size_t>(world.sights[j].free);
      Add<6>(-cross[i] * inverse * cross[j].transpose(), &sums.reduced[(row * (row + 1) / 2 + column) * kPoseBlock]);
    }
  }
  return sums;
}

void ExpectNear(const std::vector<double>& a, const std::vector<double>& b, const char* what) {
  ASSERT_EQ(a.size(), b.size());
  double scale = 0.0;
  for (const double value : b) scale = std::max(scale, std::abs(value));
  ASSERT_GT(scale, 0.0) << what;
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_NEAR(a[i], b[i], 1e-12 * scale) << what << " " << i;
}

TEST(SchurKernel, EveryLevelSumsWhatEigenDoes) {
  Random random(11);
  for (const SimdLevel level : SupportedSimdLevels()) {
    const SchurKernel kernel = SchurKernelFor(level);
    for (const double huber : {0.0, 2.0}) {
      const World world = MakeWorld(&random);
      const Sums expected = Expected(world, huber);
      Sums sums;
      sums.cross.assign(world.sights.size() * kCrossBlock, 0.0);
      kernel.linearize(world.point(), world.cameras.data(), world.position.data(), huber, sums.pose_hessian.data(),
                       sums.pose_gradient.data(), sums.point_hessian.data(), sums.point_gradient.data(),
                       sums.cross.data());
      const Matrix3d inverse = sums.point_hessian.inverse();
      kernel.eliminate(world.point(), inverse.data(), sums.point_gradient.data(), sums.cross.data(),
                       sums.reduced.data(), sums.right.data());
      SCOPED_TRACE(ToString(level));
      EXPECT_LT((sums.point_hessian - expected.point_hessian).norm(), 1e-12 * expected.point_hessian.norm());
      EXPECT_LT((sums.point_gradient - expected.point_gradient).norm(), 1e-12 * expected.point_gradient.norm());
      ExpectNear(sums.pose_hessian, expected.pose_hessian, "pose_hessian");
      ExpectNear(sums.pose_gradient, expected.pose_gradient, "pose_gradient");
      ExpectNear(sums.cross, expected.cross, "cross");
      ExpectNear(sums.reduced, expected.reduced, "reduced");
      ExpectNear(sums.right, expected.right, "right");
    }
  }
}

}  // namespace
}  // namespace cairn::optimization::internal
