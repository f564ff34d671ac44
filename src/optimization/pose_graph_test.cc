#include "optimization/pose_graph.h"

#include <ceres/jet.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <numbers>

#include "base/random.h"
#include "optimization/pose_graph_cost.h"

namespace cairn::optimization {
namespace {

Sim3 RandomSimilarity(Random& random, double translation, double rotation, double log_scale) {
  Vector7d x;
  for (int i = 0; i < 7; ++i) x[i] = random.Normal() * (i < 3 ? translation : i < 6 ? rotation : log_scale);
  return Sim3::Exp(x);
}

Vector7d Residual(const ceres::CostFunction& cost, const Sim3& a, const Sim3& b) {
  std::array<double, 8> block_a, block_b;
  internal::SimilarityToBlock(a, block_a.data());
  internal::SimilarityToBlock(b, block_b.data());
  const double* parameters[] = {block_a.data(), block_b.data()};
  Vector7d residual;
  EXPECT_TRUE(cost.Evaluate(parameters, residual.data(), nullptr));
  return residual;
}

template <class T>
Eigen::Matrix<T, 4, 4> MatrixOf(const Sim3& s) {
  Eigen::Matrix4d m = Eigen::Matrix4d::Identity();
  m.topLeftCorner<3, 3>() = s.scale() * s.RotationMatrix();
  m.topRightCorner<3, 1>() = s.translation();
  return m.cast<T>();
}

// First order of Exp(x): enough for the derivative at x = 0.
template <class T>
Eigen::Matrix<T, 4, 4> Step(const Eigen::Matrix<T, 7, 1>& x) {
  Eigen::Matrix<T, 4, 4> m = Eigen::Matrix<T, 4, 4>::Identity();
  const T one(1.0);
  m << one + x[6], -x[5], x[4], x[0], x[5], one + x[6], -x[3], x[1], -x[4], x[3], one + x[6], x[2], T(0), T(0), T(0),
      one;
  return m;
}

// Logarithm of a general similarity: scale from the determinant, angle from the trace, W from its closed form.
template <class T>
Eigen::Matrix<T, 7, 1> LogOf(const Eigen::Matrix<T, 4, 4>& m) {
  using Matrix3 = Eigen::Matrix<T, 3, 3>;
  const Matrix3 sr = m.template topLeftCorner<3, 3>();
  const T scale = pow(sr.determinant(), T(1.0 / 3.0));
  const Matrix3 r = sr / scale;
  const T t = acos((r.trace() - T(1.0)) * T(0.5));
  const T l = log(scale);
  Eigen::Matrix<T, 3, 1> w(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1));
  w *= t / (T(2.0) * sin(t));
  Matrix3 hat;
  hat << T(0), -w[2], w[1], w[2], T(0), -w[0], -w[1], w[0], T(0);
  const T a = scale * sin(t), b = scale * cos(t), d = l * l + t * t;
  const T c = (scale - T(1.0)) / l;
  const Matrix3 big = c * Matrix3::Identity() + ((a * l + (T(1.0) - b) * t) / (t * d)) * hat +
                      ((c - ((b - T(1.0)) * l + a * t) / d) / (t * t)) * (hat * hat);
  Eigen::Matrix<T, 7, 1> x;
  x.template head<3>() = big.inverse() * m.template topRightCorner<3, 1>();
  x.template segment<3>(3) = w;
  x[6] = l;
  return x;
}

TEST(PoseGraphCost, JacobiansAgreeWithDifferencesAndAutodiff) {
  Random random(5);
  for (int trial = 0; trial < 30; ++trial) {
    const Sim3 a = RandomSimilarity(random, 3.0, 0.8, 0.3), b = RandomSimilarity(random, 3.0, 0.8, 0.3);
    const Sim3 measured = RandomSimilarity(random, 0.4, 0.3, 0.3) * b * a.Inverse();
    const internal::RelativeSim3Cost cost(measured, 1.3, 2.5);
    std::array<double, 8> block_a, block_b;
    internal::SimilarityToBlock(a, block_a.data());
    internal::SimilarityToBlock(b, block_b.data());
    const double* parameters[] = {block_a.data(), block_b.data()};
    Vector7d residual;
    Eigen::Matrix<double, 7, 8, Eigen::RowMajor> by_a, by_b;
    double* jacobians[] = {by_a.data(), by_b.data()};
    ASSERT_TRUE(cost.Evaluate(parameters, residual.data(), jacobians));

    using Jet = ceres::Jet<double, 14>;
    Eigen::Matrix<Jet, 7, 1> x, y;
    for (int i = 0; i < 7; ++i) {
      x[i] = Jet(0.0, i);
      y[i] = Jet(0.0, i + 7);
    }
    const Eigen::Matrix<Jet, 4, 4> moved_b = Step<Jet>(y) * MatrixOf<Jet>(b);
    const Eigen::Matrix<Jet, 7, 1> automatic =
        LogOf<Jet>(MatrixOf<Jet>(measured) * Step<Jet>(x) * MatrixOf<Jet>(a) * moved_b.inverse());
    for (int row = 0; row < 7; ++row) {
      const double weight = row < 3 ? 1.3 / 2.5 : 1.3;
      EXPECT_NEAR(residual[row], weight * automatic[row].a, 1e-9);
      for (int i = 0; i < 7; ++i) {
        EXPECT_NEAR(by_a(row, i), weight * automatic[row].v[i], 1e-7);
        EXPECT_NEAR(by_b(row, i), weight * automatic[row].v[i + 7], 1e-7);
      }
    }
    constexpr double kStep = 1e-6;
    for (int i = 0; i < 7; ++i) {
      const Sim3 plus = Sim3::Exp(Vector7d::Unit(i) * kStep), minus = Sim3::Exp(-Vector7d::Unit(i) * kStep);
      const Vector7d difference_a = (Residual(cost, plus * a, b) - Residual(cost, minus * a, b)) / (2 * kStep);
      const Vector7d difference_b = (Residual(cost, a, plus * b) - Residual(cost, a, minus * b)) / (2 * kStep);
      EXPECT_LT((difference_a - by_a.col(i)).norm(), 1e-6 * (1.0 + difference_a.norm()));
      EXPECT_LT((difference_b - by_b.col(i)).norm(), 1e-6 * (1.0 + difference_b.norm()));
    }
    EXPECT_EQ(by_a.col(7), Vector7d::Zero());
  }
}

TEST(PoseGraphCost, LeftJacobianIsThatOfTheExponential) {
  Random random(6);
  for (int trial = 0; trial < 20; ++trial) {
    Vector7d x, d;
    for (int i = 0; i < 7; ++i) {
      x[i] = random.Normal();
      d[i] = 1e-6 * random.Normal();
    }
    const Vector7d moved = (Sim3::Exp(x + d) * Sim3::Exp(x).Inverse()).Log();
    EXPECT_LT((moved - internal::LeftJacobianSim3(x) * d).norm(), 1e-10);
  }
  EXPECT_LT((internal::LeftJacobianSim3(Vector7d::Zero()) - Matrix7d::Identity()).norm(), 1e-15);
}

// Cameras on a circle whose measured motions all shrink by the same factor, and a loop edge that is true.
struct Circle {
  PoseGraphProblem problem;
  std::vector<SE3> truth;

  Circle(int count, double shrink, double noise) {
    Random random(7);
    for (int i = 0; i < count; ++i) {
      const double angle = 2.0 * std::numbers::pi * i / count;
      const SE3 world_from_camera(ExpSO3(Vector3d(0, angle, 0)), Vector3d(5 * std::sin(angle), 0, 5 * std::cos(angle)));
      truth.push_back(world_from_camera.Inverse());
    }
    problem.nodes.push_back({Sim3(truth[0]), true});
    for (int i = 1; i < count; ++i) {
      const SE3 motion = truth[i] * truth[i - 1].Inverse();
      // The unit of length at camera i is 1 / shrink^i of the first.
      const Sim3 drifted = RandomSimilarity(random, noise, noise, noise) *
                           Sim3(motion.rotation(), motion.translation() * shrink, shrink);
      problem.nodes.push_back({drifted * problem.nodes.back().camera_from_map, false});
      const Sim3 measured(drifted);
      problem.edges.push_back({static_cast<std::uint32_t>(i - 1), static_cast<std::uint32_t>(i), measured, 1.0});
    }
  }

  double Error(const std::vector<Sim3>& camera_from_map) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      sum += (camera_from_map[i].Inverse().translation() - truth[i].Inverse().translation()).squaredNorm();
    }
    return std::sqrt(sum / static_cast<double>(truth.size()));
  }
  std::vector<Sim3> Start() const {
    std::vector<Sim3> start;
    for (const PoseGraphNode& node : problem.nodes) start.push_back(node.camera_from_map);
    return start;
  }
};

TEST(PoseGraph, ConsistentGraphIsRecoveredExactly) {
  Circle circle(40, 1.0, 0.0);
  const auto count = static_cast<std::uint32_t>(circle.truth.size());
  circle.problem.edges.push_back({count - 1, 0, Sim3(circle.truth[0] * circle.truth.back().Inverse()), 1.0});
  Random random(8);
  for (std::uint32_t i = 1; i < count; ++i) {
    Sim3& node = circle.problem.nodes[i].camera_from_map;
    node = RandomSimilarity(random, 0.3, 0.1, 0.1) * node;
  }
  const auto result = OptimizePoseGraph(circle.problem);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_LT(circle.Error(result->camera_from_map), 1e-4);
  EXPECT_LT(result->final_cost, 1e-8);
  EXPECT_EQ(result->camera_from_map[0].translation(), circle.problem.nodes[0].camera_from_map.translation());
}

TEST(PoseGraph, LoopEdgeTakesOutScaleDrift) {
  // 60 edges of 1 % make the unit 1.8 times as long at the end.
  Circle circle(60, 0.99, 0.001);
  for (std::size_t i = 1; i < circle.problem.nodes.size(); ++i) {
    // What odometry believes: a rigid motion in its own unit, which shrinks on.
    PoseGraphEdge& edge = circle.problem.edges[i - 1];
    edge.b_from_a = Sim3(edge.b_from_a.rotation(), std::pow(0.99, double(i) - 1.0) * edge.b_from_a.translation(), 1.0);
    circle.problem.nodes[i].camera_from_map = edge.b_from_a * circle.problem.nodes[i - 1].camera_from_map;
  }
  const double before = circle.Error(circle.Start());
  const SE3 closing = circle.truth[0] * circle.truth.back().Inverse();
  const double unit = std::pow(0.99, 59.0);
  circle.problem.edges.push_back({59, 0, Sim3(closing.rotation(), closing.translation(), 1.0 / unit), 1.0});
  const auto result = OptimizePoseGraph(circle.problem);
  ASSERT_TRUE(result.ok()) << result.status();
  EXPECT_GT(before, 0.5);
  EXPECT_LT(circle.Error(result->camera_from_map), 0.1 * before);
  EXPECT_NEAR(result->camera_from_map.back().scale(), unit, 0.02);
  // Twice the same.
  const auto again = OptimizePoseGraph(circle.problem);
  ASSERT_TRUE(again.ok());
  for (std::size_t i = 0; i < again->camera_from_map.size(); ++i) {
    EXPECT_EQ(again->camera_from_map[i].translation(), result->camera_from_map[i].translation());
  }
}

TEST(PoseGraph, UnitOfLengthDoesNotMatter) {
  Circle circle(20, 0.98, 0.0);
  const SE3 closing = circle.truth[0] * circle.truth.back().Inverse();
  circle.problem.edges.push_back({19, 0, Sim3(closing.rotation(), closing.translation(), 1.3), 1.0});
  PoseGraphProblem larger = circle.problem;
  const auto enlarge = [](const Sim3& s) { return Sim3(s.rotation(), 10.0 * s.translation(), s.scale()); };
  for (PoseGraphNode& node : larger.nodes) node.camera_from_map = enlarge(node.camera_from_map);
  for (PoseGraphEdge& edge : larger.edges) edge.b_from_a = enlarge(edge.b_from_a);
  PoseGraphOptions options;
  const auto small = OptimizePoseGraph(circle.problem, options);
  options.translation_unit = 10.0;
  const auto large = OptimizePoseGraph(larger, options);
  ASSERT_TRUE(small.ok() && large.ok());
  for (std::size_t i = 0; i < small->camera_from_map.size(); ++i) {
    EXPECT_LT((10.0 * small->camera_from_map[i].translation() - large->camera_from_map[i].translation()).norm(), 1e-5);
  }
}

TEST(PoseGraph, RejectsBadInput) {
  PoseGraphProblem problem;
  problem.nodes.resize(3);
  problem.edges.push_back({0, 1, Sim3(), 1.0});
  EXPECT_TRUE(absl::IsFailedPrecondition(OptimizePoseGraph(problem).status()));
  problem.nodes[0].fixed = true;
  EXPECT_TRUE(OptimizePoseGraph(problem).ok());  // node 2 has no edge and stays
  problem.edges.push_back({1, 3, Sim3(), 1.0});
  EXPECT_TRUE(absl::IsInvalidArgument(OptimizePoseGraph(problem).status()));
  problem.edges.back() = {1, 1, Sim3(), 1.0};
  EXPECT_TRUE(absl::IsInvalidArgument(OptimizePoseGraph(problem).status()));
  problem.edges.back() = {1, 2, Sim3(), 0.0};
  EXPECT_TRUE(absl::IsInvalidArgument(OptimizePoseGraph(problem).status()));
  problem.edges.back() = {1, 2, Sim3(Quaterniond::Identity(), Vector3d(NAN, 0, 0), 1.0), 1.0};
  EXPECT_TRUE(absl::IsInvalidArgument(OptimizePoseGraph(problem).status()));
  problem.edges.pop_back();
  EXPECT_TRUE(absl::IsInvalidArgument(OptimizePoseGraph(problem, {.max_iterations = 0}).status()));
  EXPECT_TRUE(absl::IsInvalidArgument(OptimizePoseGraph(problem, {.translation_unit = 0.0}).status()));
  EXPECT_TRUE(OptimizePoseGraph({}).ok());
}

}  // namespace
}  // namespace cairn::optimization
