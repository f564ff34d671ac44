// Self-calibration by bundle adjustment: what the calibration of one camera left over (geometry/lens_correction.h),
// together with all poses and points (Triggs et al., "Bundle adjustment - a modern synthesis", 2000; Fraser, "Digital
// camera self-calibration", 1997). A focal length that is wrong by a few per cent costs little in each image, but turns
// too far in every turn, and the scale of the map gives way.
//
// Levenberg-Marquardt in Ceres with SuiteSparse; derivatives by hand (geometry/camera.h), left increments of
// camera_from_map.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "geometry/lens_correction.h"
#include "optimization/bundle_adjustment.h"

namespace cairn::optimization {

struct LensAdjustmentOptions {
  int max_iterations = 50;
  double function_tolerance = 1e-7;
  // Priors: the calibration is about right. They hold what the observations leave open.
  double log_focal_sigma = 0.005;
  double k1_sigma = 0.02;
  double k2_sigma = 0.02;

  absl::Status Validate() const;
};

struct LensResult {
  LensCorrection lens;
  std::vector<SE3> camera_from_map;  // per pose
  std::vector<Vector3d> points;
  double sigma_px = 0.0;  // of an observation at octave 0, per axis, from the residuals left
  // By how much the sum of squared residuals fell against the same problem with no correction, both at their minimum,
  // in units of the variance: chi-square with three degrees of freedom if there is nothing to correct.
  double gain = 0.0;
};

// `problem` should be near its minimum already (AdjustBundle). `camera`: index into problem.cameras; the others stay as
// they are. `used`: per observation, 0 leaves it out. Errors as AdjustBundle's.
absl::StatusOr<LensResult> AdjustLens(const BundleProblem& problem, std::uint32_t camera,
                                      std::span<const std::uint8_t> used, const LensAdjustmentOptions& options = {});

}  // namespace cairn::optimization
