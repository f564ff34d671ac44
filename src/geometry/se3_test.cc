#include "geometry/se3.h"

#include <gtest/gtest.h>

#include "base/random.h"

namespace cairn {
namespace {

template <int N>
Eigen::Matrix<double, N, 1> RandomVector(Random& random, double scale) {
  Eigen::Matrix<double, N, 1> v;
  for (int i = 0; i < N; ++i) v[i] = random.Normal(0.0, scale);
  return v;
}

TEST(SE3, ExpAndLogAreInverse) {
  Random random(1);
  for (const double scale : {1e-9, 1e-6, 1e-4, 1e-2, 0.5}) {
    for (int i = 0; i < 50; ++i) {
      const Vector6d x = RandomVector<6>(random, scale);
      EXPECT_LT((SE3::Exp(x).Log() - x).norm(), 1e-9 * std::max(1.0, x.norm())) << x.transpose();
    }
  }
}

TEST(SE3, LogNearPiKeepsTheRotation) {
  const SE3 turn = SE3::Exp((Vector6d() << 1, 2, 3, 3.141592, 0, 0).finished());
  EXPECT_LT((SE3::Exp(turn.Log()).Matrix() - turn.Matrix()).norm(), 1e-6);
}

TEST(SE3, InverseAndProduct) {
  Random random(2);
  const SE3 a = SE3::Exp(RandomVector<6>(random, 1.0)), b = SE3::Exp(RandomVector<6>(random, 1.0));
  const Vector3d p(0.3, -0.2, 1.5);
  EXPECT_LT(((a * b) * p - a * (b * p)).norm(), 1e-12);
  EXPECT_LT((a.Inverse() * (a * p) - p).norm(), 1e-12);
}

TEST(SE3, AdjointMovesAnIncrementAcross) {
  Random random(3);
  const SE3 a = SE3::Exp(RandomVector<6>(random, 1.0));
  const Vector6d x = RandomVector<6>(random, 0.1);
  EXPECT_LT(((SE3::Exp(a.Adjoint() * x) * a).Matrix() - (a * SE3::Exp(x)).Matrix()).norm(), 1e-12);
}

TEST(SO3, LeftJacobianAgainstDifferences) {
  Random random(4);
  const Vector3d w = RandomVector<3>(random, 1.0);
  const Matrix3d j = LeftJacobianSO3(w);
  for (int k = 0; k < 3; ++k) {
    const Vector3d d = 1e-6 * Vector3d::Unit(k);
    const Vector3d change = LogSO3(ExpSO3(w + d) * ExpSO3(w - d).conjugate()) / 2e-6;
    EXPECT_LT((change - j.col(k)).norm(), 1e-8);
  }
}

TEST(Sim3, ExpAndLogAreInverseInEveryBranch) {
  Random random(5);
  for (const double angle : {1e-8, 1e-3, 1.0}) {
    for (const double lambda : {0.0, 1e-9, 1e-6, 9e-6, 1.1e-5, 1e-3, -0.7}) {
      Vector7d x = RandomVector<7>(random, 1.0);
      x.segment<3>(3) *= angle;
      x[6] = lambda;
      EXPECT_LT((Sim3::Exp(x).Log() - x).norm(), 1e-8) << x.transpose();
    }
  }
}

// The exponential is the flow of its own tangent: Exp(x) = Exp(x/2)^2. This ties the translation part to the group.
TEST(Sim3, ExpIsAOneParameterGroupInEveryBranch) {
  Random random(6);
  for (const double angle : {0.0, 1e-8, 1e-4, 1.0}) {
    for (const double lambda : {0.0, 1e-7, 9e-6, 1e-4, 0.5, -0.5}) {
      Vector7d x = RandomVector<7>(random, 1.0);
      x.segment<3>(3) *= angle;
      x[6] = lambda;
      const Sim3 half = Sim3::Exp(0.5 * x), whole = Sim3::Exp(x), twice = half * half;
      EXPECT_LT((whole.translation() - twice.translation()).norm(), 1e-6) << angle << " " << lambda;
      EXPECT_LT(whole.rotation().angularDistance(twice.rotation()), 1e-9);
      EXPECT_NEAR(whole.scale(), twice.scale(), 1e-12);
    }
  }
}

TEST(Sim3, InverseProductAndPose) {
  Random random(7);
  const Sim3 a = Sim3::Exp(RandomVector<7>(random, 0.5)), b = Sim3::Exp(RandomVector<7>(random, 0.5));
  const Vector3d p(0.3, -0.2, 1.5);
  EXPECT_LT(((a * b) * p - a * (b * p)).norm(), 1e-12);
  EXPECT_LT((a.Inverse() * (a * p) - p).norm(), 1e-12);
  const SE3 pose = SE3::Exp(RandomVector<6>(random, 0.5));
  // A point seen by the camera lies in the same direction after the map is transformed.
  const Vector3d before = pose.Inverse() * p, after = a.TransformPose(pose).Inverse() * (a * p);
  EXPECT_LT((after.normalized() - before.normalized()).norm(), 1e-12);
}

}  // namespace
}  // namespace cairn
