// How precise the measurements of a bundle problem are, told by how they disagree near its solution: the components of
// variance (Koch, "Parameter Estimation and Hypothesis Testing in Linear Models", 1999, Sec. 3.6), from medians, so
// that wrong measurements do not count. Private to optimization.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "optimization/bundle_adjustment.h"

namespace cairn::optimization {

// Standard deviation of an observation per axis, as a share of its sigma_px. `chi2`: squared residuals over sigma_px^2,
// of which `used` count, and only at points seen often enough that the residuals are not absorbed by the point. 0 if
// these are too few to tell.
double PixelNoise(const BundleProblem& problem, std::span<const std::uint8_t> used, std::span<const double> chi2);

// Standard deviation of one step of the problem's rotations per axis, from how they differ from `poses`: the errors of
// both together, so never less than it is. Errors that add up along a chain of rotations (each from the pose that the
// one before led to) disagree the more the longer the way; the way over which they disagree most counts. 0 if there are
// too few to tell.
double RotationNoise(const BundleProblem& problem, std::span<const SE3> poses);

}  // namespace cairn::optimization
