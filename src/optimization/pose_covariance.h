// How precisely the observations of a bundle problem determine its poses, at its minimum: the inverse of the normal
// equations, reduced to the poses (Triggs et al., "Bundle adjustment - a modern synthesis", 2000, Sec. 6.1), with the
// noise that the residuals show. Where nothing is held, what a similarity of everything changes is not determined, and
// no error: the covariance is that after the similarity that fits the centres best (inner constraints, ibid., Sec. 9),
// as trajectories are compared.
//
// What is wrong with the model (lens, shutter, matches that agree by chance) is not in it: true errors are larger.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "optimization/bundle_adjustment.h"

namespace cairn::optimization {

// Standard deviations per axis (root mean square of the three).
struct PoseSigma {
  double position = 0.0;  // of the centre, map units; 0: fixed
  double rotation_rad = 0.0;
};

struct PoseUncertainty {
  double noise_px = 0.0;         // of an observation per axis, over its sigma_px
  std::vector<PoseSigma> poses;  // per pose
};

// `problem` at its minimum. `used`: per observation, 0 leaves it out. The work grows with the cube of the free poses.
// FailedPrecondition: more than `max_poses` of them, or too few observations. Else errors as AdjustBundle's, but that
// nothing need be fixed.
absl::StatusOr<PoseUncertainty> UncertaintyOfPoses(const BundleProblem& problem, std::span<const std::uint8_t> used,
                                                   int max_poses = 200);

}  // namespace cairn::optimization
