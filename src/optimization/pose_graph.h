// Pose graph of similarities: spreads the error of a loop, scale included, over all poses between (Strasdat, Montiel,
// Davison, "Scale drift-aware large scale monocular SLAM", RSS 2010). Knows nothing of maps: flat arrays in and out.
//
// Minimizes the sum of |Log(b_from_a S_a S_b^-1)|^2 over the edges, S = camera_from_map of a node, by Levenberg-
// Marquardt with a sparse Cholesky factorization in Ceres on one thread; derivatives by hand
// (optimization/pose_graph_cost.h).
#pragma once

#include <cstdint>
#include <vector>

#include "base/status.h"
#include "geometry/se3.h"

namespace cairn::optimization {

struct PoseGraphNode {
  Sim3 camera_from_map;
  bool fixed = false;
};

struct PoseGraphEdge {
  std::uint32_t a = 0;  // nodes
  std::uint32_t b = 0;
  Sim3 b_from_a;        // measured
  double weight = 1.0;  // one over the standard deviation, up to a common factor
};

struct PoseGraphProblem {
  std::vector<PoseGraphNode> nodes;
  std::vector<PoseGraphEdge> edges;
};

struct PoseGraphOptions {
  int max_iterations = 30;
  // Length, in the nodes' units, that counts as much as a radian or a doubling of the scale (by e): the typical
  // distance of what the cameras see makes the answer independent of the map's unit.
  double translation_unit = 1.0;
  double function_tolerance = 1e-7;  // ends when the cost falls by less than this share

  absl::Status Validate() const;
};

struct PoseGraphResult {
  std::vector<Sim3> camera_from_map;  // per node
  double initial_cost = 0.0;          // half the sum of squared weighted residuals
  double final_cost = 0.0;
  int iterations = 0;  // successful steps
};

// InvalidArgument: bad options, indices out of range, an edge from a node to itself, values that are not finite,
// weights that are not positive. FailedPrecondition: a node that edges link to no fixed node (it would float). Nodes
// without edges stay as they are. Internal: the solver failed.
absl::StatusOr<PoseGraphResult> OptimizePoseGraph(const PoseGraphProblem& problem,
                                                  const PoseGraphOptions& options = {});

}  // namespace cairn::optimization
