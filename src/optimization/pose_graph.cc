#include "optimization/pose_graph.h"

#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <numeric>

#include "optimization/pose_graph_cost.h"

namespace cairn::optimization {
namespace {

absl::Status InvalidPoseGraph(const std::string& what) { return absl::InvalidArgumentError("pose graph: " + what); }

bool IsFinite(const Sim3& similarity) {
  return similarity.rotation().coeffs().allFinite() && similarity.translation().allFinite() &&
         std::isfinite(similarity.scale()) && similarity.scale() > 0.0;
}

// Every node that has an edge must hang on a fixed one.
absl::Status CheckAnchored(const PoseGraphProblem& problem) {
  std::vector<std::uint32_t> root(problem.nodes.size());
  std::iota(root.begin(), root.end(), 0u);
  const auto find = [&root](std::uint32_t node) {
    while (root[node] != node) node = root[node] = root[root[node]];
    return node;
  };
  for (const PoseGraphEdge& edge : problem.edges) root[find(edge.a)] = find(edge.b);
  std::vector<std::uint8_t> anchored(problem.nodes.size(), 0);
  for (std::uint32_t i = 0; i < root.size(); ++i) {
    if (problem.nodes[i].fixed) anchored[find(i)] = 1;
  }
  for (const PoseGraphEdge& edge : problem.edges) {
    if (anchored[find(edge.a)]) continue;
    return absl::FailedPreconditionError(absl::StrCat("pose graph: node ", edge.a, " is linked to no fixed node"));
  }
  return absl::OkStatus();
}

absl::Status Check(const PoseGraphProblem& problem) {
  for (std::size_t i = 0; i < problem.nodes.size(); ++i) {
    if (!IsFinite(problem.nodes[i].camera_from_map))
      return InvalidPoseGraph(absl::StrCat("node ", i, " is not finite"));
  }
  for (std::size_t i = 0; i < problem.edges.size(); ++i) {
    const PoseGraphEdge& edge = problem.edges[i];
    if (edge.a >= problem.nodes.size() || edge.b >= problem.nodes.size() || edge.a == edge.b) {
      return InvalidPoseGraph(absl::StrCat("edge ", i, " refers to a node that does not exist, or to one node twice"));
    }
    if (!IsFinite(edge.b_from_a) || !(edge.weight > 0.0) || !std::isfinite(edge.weight)) {
      return InvalidPoseGraph(absl::StrCat("edge ", i, " is not finite or its weight is not positive"));
    }
  }
  return CheckAnchored(problem);
}

}  // namespace

absl::Status PoseGraphOptions::Validate() const {
  if (max_iterations < 1) return InvalidPoseGraph("max_iterations must be at least 1");
  if (!(translation_unit > 0.0) || !std::isfinite(translation_unit))
    return InvalidPoseGraph("translation_unit must be positive");
  if (!(function_tolerance > 0.0)) return InvalidPoseGraph("function_tolerance must be positive");
  return absl::OkStatus();
}

absl::StatusOr<PoseGraphResult> OptimizePoseGraph(const PoseGraphProblem& problem, const PoseGraphOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(Check(problem));
  PoseGraphResult result;
  std::vector<std::array<double, 8>> blocks(problem.nodes.size());
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    internal::SimilarityToBlock(problem.nodes[i].camera_from_map, blocks[i].data());
    result.camera_from_map.push_back(problem.nodes[i].camera_from_map);
  }

  ceres::Problem::Options ownership;
  ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  internal::Sim3LeftIncrementManifold manifold;
  std::deque<internal::RelativeSim3Cost> costs;
  ceres::Problem ceres_problem(ownership);
  for (const PoseGraphEdge& edge : problem.edges) {
    for (const std::uint32_t node : {edge.a, edge.b}) {
      if (ceres_problem.HasParameterBlock(blocks[node].data())) continue;
      ceres_problem.AddParameterBlock(blocks[node].data(), 8, &manifold);
      if (problem.nodes[node].fixed) ceres_problem.SetParameterBlockConstant(blocks[node].data());
    }
    costs.emplace_back(edge.b_from_a, edge.weight, options.translation_unit);
    ceres_problem.AddResidualBlock(&costs.back(), nullptr, blocks[edge.a].data(), blocks[edge.b].data());
  }
  if (ceres_problem.NumResidualBlocks() == 0) return result;

  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.function_tolerance;
  solver.initial_trust_region_radius = 1e8;  // nearly Gauss-Newton: the start is good and the problem well conditioned
  solver.num_threads = 1;
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &ceres_problem, &summary);
  if (!summary.IsSolutionUsable()) {
    return absl::InternalError("pose graph: the solver failed: " + summary.message);
  }
  result.initial_cost = summary.initial_cost;
  result.final_cost = summary.final_cost;
  result.iterations = std::max(0, summary.num_successful_steps - 1);
  for (std::size_t i = 0; i < blocks.size(); ++i) {
    if (!problem.nodes[i].fixed) result.camera_from_map[i] = internal::SimilarityFromBlock(blocks[i].data());
  }
  return result;
}

}  // namespace cairn::optimization
