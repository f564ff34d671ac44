// Similarity and rigid alignment of two sets of corresponding points, a_i ~ a_from_b * b_i.
//
// Closed form: Umeyama, "Least-squares estimation of transformation parameters between two point patterns" (PAMI 1991),
// which is Horn's solution (JOSA A 1987) with reflections excluded; both minimise sum w_i |a_i - a_from_b b_i|^2.
// The robust variant wraps it in RANSAC (Fischler, Bolles 1981) or, without a threshold, least median of squares
// (Rousseeuw 1984), and finishes with iteratively reweighted least squares under a Cauchy loss.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "geometry/se3.h"

namespace cairn {

struct AlignmentOptions {
  // False: rigid, the scale is 1.
  bool with_scale = true;
  // The rotation about a line is unknown. Points count as on a line when their spread across it is below this share of
  // their spread along it.
  double min_spread_ratio = 1e-5;
  // True: points on a line give the scale, the translation and the smallest of the possible rotations, and
  // `rotation_known` is false. False: they give FailedPrecondition.
  bool allow_collinear = false;

  absl::Status Validate() const;
};

struct RobustAlignmentOptions {
  AlignmentOptions alignment = {};
  // A pair further apart than this after alignment is an outlier, in units of frame a. 0: estimated from the median of
  // the residuals, which needs more than half of the pairs to be good.
  double inlier_threshold = 0.0;
  int max_samples = 500;
  // Sampling stops early once a sample of inliers has been seen with this probability (known threshold only).
  double confidence = 0.999;
  int reweighting_iterations = 10;
  int min_inliers = 3;
  std::uint64_t seed = 1;

  absl::Status Validate() const;
};

struct Alignment {
  Sim3 a_from_b;
  // Root of the weighted mean square of |a_i - a_from_b b_i|, in units of frame a, over the inliers.
  double rmse = 0.0;
  // Standard deviations, first order, from the residuals: of the scale (0 without scale), and of the rotation about its
  // worst axis in radians (pi when it is not known). 0 with no redundancy.
  double scale_sigma = 0.0;
  double rotation_sigma_rad = 0.0;
  // False only for points on a line with allow_collinear.
  bool rotation_known = true;
  // Per pair: takes part. All true for the closed form, but for pairs of weight 0.
  std::vector<bool> inlier;
  int inlier_count = 0;
};

// Errors: InvalidArgument when the sizes differ, a number is not finite or a weight is negative; FailedPrecondition
// when the pairs do not determine the answer (fewer than 3, coincident, or on a line: the message says which).
absl::StatusOr<Alignment> AlignPoints(std::span<const Vector3d> points_a, std::span<const Vector3d> points_b,
                                      const AlignmentOptions& options = {});

// Weights are inverse variances up to a common factor; 0 leaves a pair out.
absl::StatusOr<Alignment> AlignPointsWeighted(std::span<const Vector3d> points_a, std::span<const Vector3d> points_b,
                                              std::span<const double> weights, const AlignmentOptions& options = {});

// FailedPrecondition also when no sample has min_inliers inliers.
absl::StatusOr<Alignment> AlignPointsRobust(std::span<const Vector3d> points_a, std::span<const Vector3d> points_b,
                                            const RobustAlignmentOptions& options = {});

}  // namespace cairn
