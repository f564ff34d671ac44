// Levenberg-Marquardt for bundle adjustment with few free poses and many points. The normal equations are reduced to
// the poses by the Schur complement of the points (Triggs et al., "Bundle adjustment - a modern synthesis", 2000, Sec.
// 6.1) and solved as one dense system; the damping follows Nielsen, "Damping parameter in Marquardt's method" (1999).
// Same minimum as Ceres, at a fraction of its time for the few iterations that local bundle adjustment allows: nothing
// is built per residual. Derivatives by hand (optimization/reprojection.h). Private to optimization.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "optimization/bundle_adjustment.h"

namespace cairn::optimization::internal {

struct SchurOptions {
  int max_iterations = 10;
  double huber_threshold = 0.0;      // whitened; 0: squared loss
  double rotation_sigma_rad = 0.0;   // of one step of the problem's rotations; 0: these take no part
  double rotation_threshold = 0.0;   // of Huber's loss on them, whitened; 0: squared loss
  double function_tolerance = 1e-4;  // ends when the cost falls by less than this share
  const std::atomic<bool>* stop = nullptr;
};

struct SchurSummary {
  bool usable = true;  // false: the equations could not be solved, nothing was changed
  double initial_cost = 0.0;
  double final_cost = 0.0;
  int steps = 0;  // that lowered the cost
};

// Adjusts poses that are not fixed and points that have a `used` observation, from and to `poses` and `points`.
// `used`: per observation of the problem; those it leaves out take no part. All used observations must be in front of
// their cameras at the start.
SchurSummary MinimizeBundle(const BundleProblem& problem, std::span<const std::uint8_t> used,
                            const SchurOptions& options, std::vector<SE3>* poses, std::vector<Vector3d>* points);

}  // namespace cairn::optimization::internal
