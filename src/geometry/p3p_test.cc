#include "geometry/p3p.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "base/random.h"

namespace cairn {
namespace {

struct Problem {
  SE3 camera_from_world;
  P3PPoints points;
  P3PRays rays;
};

Vector3d RandomVector(Random& random) { return {random.Normal(), random.Normal(), random.Normal()}; }

// Three points in a cone of about 60 degrees before a camera anywhere; `flatness` 0: all at one depth.
Problem MakeProblem(Random& random, double scale, double flatness) {
  Problem problem;
  problem.camera_from_world = SE3(ExpSO3(RandomVector(random)), scale * RandomVector(random));
  for (std::size_t i = 0; i < 3; ++i) {
    const double depth = scale * (3.0 + flatness * random.Uniform(-2.0, 4.0));
    const Vector3d point_c = depth * Vector3d(random.Uniform(-0.6, 0.6), random.Uniform(-0.6, 0.6), 1.0);
    problem.points[i] = problem.camera_from_world.Inverse() * point_c;
    problem.rays[i] = point_c.normalized();
  }
  return problem;
}

// By translation and rotation together, lengths in units of the scene's.
double Difference(const SE3& a, const SE3& b, double scale) {
  Vector6d difference = (a * b.Inverse()).Log();
  difference.head<3>() /= scale;
  return difference.norm();
}

TEST(P3P, TheTruePoseIsAmongTheAnswersAndEachSeesThePoints) {
  Random random(1);
  int missed = 0, several = 0;
  for (int n = 0; n < 20000; ++n) {
    const double scale = n % 3 == 0 ? 1e-3 : n % 3 == 1 ? 1.0 : 1e4;
    const Problem problem = MakeProblem(random, scale, n % 2 == 0 ? 1.0 : 0.0);
    P3PPoses poses;
    const int count = SolveP3P(problem.rays, problem.points, &poses);
    ASSERT_GE(count, 0);
    ASSERT_LE(count, 4);
    double best = 1.0;
    for (int k = 0; k < count; ++k) {
      const SE3& pose = poses[static_cast<std::size_t>(k)];
      best = std::min(best, Difference(pose, problem.camera_from_world, scale));
      for (std::size_t i = 0; i < 3; ++i) {
        const Vector3d seen = pose * problem.points[i];
        EXPECT_GT(seen.dot(problem.rays[i]), 0.0);
        EXPECT_LT(seen.normalized().cross(problem.rays[i]).norm(), 1e-4) << n;
      }
    }
    missed += best < 1e-5 ? 0 : 1;
    several += count > 1 ? 1 : 0;
  }
  EXPECT_LE(missed, 20) << "of 20000; those are nearly degenerate";
  EXPECT_GT(several, 1000);
}

TEST(P3P, AnswersAreDifferent) {
  Random random(2);
  for (int n = 0; n < 1000; ++n) {
    const Problem problem = MakeProblem(random, 1.0, 1.0);
    P3PPoses poses;
    const int count = SolveP3P(problem.rays, problem.points, &poses);
    int same = 0;
    for (int i = 0; i < count; ++i) {
      for (int j = 0; j < i; ++j) {
        same += Difference(poses[static_cast<std::size_t>(i)], poses[static_cast<std::size_t>(j)], 1.0) < 1e-9 ? 1 : 0;
      }
    }
    EXPECT_EQ(same, 0) << n;
  }
}

TEST(P3P, WhatIsNotDeterminedHasNoAnswer) {
  P3PPoses poses;
  Problem problem;
  Random random(3);
  problem = MakeProblem(random, 1.0, 1.0);
  problem.points[2] = 2.0 * problem.points[1] - problem.points[0];
  EXPECT_EQ(SolveP3P(problem.rays, problem.points, &poses), 0) << "collinear points";
  problem.points[2] = problem.points[1];
  EXPECT_EQ(SolveP3P(problem.rays, problem.points, &poses), 0) << "a point twice";

  // Nothing that is not finite comes out, whatever goes in.
  for (int n = 0; n < 2000; ++n) {
    problem = MakeProblem(random, 1.0, 1.0);
    for (Vector3d& ray : problem.rays) ray = RandomVector(random).normalized();
    if (n % 2 == 0) problem.rays[1] = problem.rays[0];
    if (n % 5 == 0) problem.points[1] = problem.points[0] + 1e-9 * RandomVector(random);
    const int count = SolveP3P(problem.rays, problem.points, &poses);
    for (int k = 0; k < count; ++k) EXPECT_TRUE(poses[static_cast<std::size_t>(k)].Matrix().allFinite());
  }
}

}  // namespace
}  // namespace cairn
