// The pose of a camera from 2D-3D matches of which many may be wrong: minimal solver in RANSAC.
//
// Three-point solver of geometry/p3p.h; samples drawn best matches first (Chum, Matas, "Matching with PROSAC", CVPR
// 2005); truncated squared error as score (Torr, Zisserman, "MLESAC", CVIU 2000); every new best is refined on its
// inliers (Chum, Matas, Kittler, "Locally optimized RANSAC", DAGM 2003).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "optimization/pose_refinement.h"

namespace cairn::tracking {

struct PnpOptions {
  int max_iterations = 400;
  double confidence = 0.999;     // of having drawn a sample without outliers; ends earlier when reached
  double chi2_threshold = 9.21;  // of a residual whitened by sigma_px (99 %): inlier up to here
  int min_inliers = 10;          // fewer: no answer
  std::uint64_t seed = 1;        // the same input and seed give the same answer

  absl::Status Validate() const;
};

struct PnpSolution {
  bool found = false;  // at least min_inliers agree
  SE3 camera_from_map;
  std::vector<std::uint8_t> inlier;  // per match
  int num_inliers = 0;               // of the best pose, also when not found
  int iterations = 0;
};

// `matches` from the most to the least trustworthy. InvalidArgument: bad options.
absl::StatusOr<PnpSolution> SolvePnpRansac(const Pinhole& pinhole,
                                           std::span<const optimization::PoseObservation> matches,
                                           const PnpOptions& options = {});

}  // namespace cairn::tracking
