// Similarity alignment of two sets of poses of one camera, a ~ a_from_b * b: positions and orientations together, each
// weighted by its noise. A camera that mostly turns, or that drives straight on, leaves a rotation open that its
// orientations show; positions alone show the scale.
//
// Maximum likelihood with noises that nobody has to give: alternates iteratively reweighted least squares
// (geometry/pose_alignment_model.h) under Student's t (4 degrees of freedom; Lange, Little, Taylor, "Robust statistical
// modeling using the t distribution", JASA 1989) with estimating the two noises from the median residuals. The
// covariance is that of an M-estimator (Huber, "Robust statistics", 1981, Sec. 7.6), widened by the serial correlation
// of the residuals: a map that bends does not average out. The start is robust up to half of the pairs: each pair votes
// for a rotation, and least median of squares gives scale and translation.
//
// What the orientations of a mean is found out first (geometry/orientation_agreement.h). If they are a body's, where
// the camera sits on it is estimated along (hand-eye calibration); if they mean nothing, positions decide alone.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/status.h"
#include "geometry/orientation_agreement.h"
#include "geometry/se3.h"

namespace cairn {

struct PoseAlignmentOptions {
  bool use_orientations = true;
  bool with_scale = true;  // false: rigid, the scale is 1
  // Standard deviations per axis of a pair, reference and map together, in units of a and radians; 0: estimated.
  double sigma_position = 0.0;
  double sigma_rotation_rad = 0.0;
  int max_samples = 500;
  std::uint64_t seed = 1;
  OrientationAgreementOptions agreement = {};

  absl::Status Validate() const;
};

struct PoseAlignment {
  Sim3 a_from_b;
  // `kind` says whether orientations took part (kCamera, kBody). Of kBody, `camera_from_body` is the final estimate.
  OrientationAgreement orientations;
  bool orientations_used = false;
  // Of a left increment about the centre of b's positions: centre in units of a, rotation in radians, log scale.
  Matrix7d covariance = Matrix7d::Zero();
  Vector3d center_b = Vector3d::Zero();
  // Standard deviations: of the scale, and of rotation and centre about their worst axes.
  double scale_sigma = 0.0;
  double rotation_sigma_rad = 0.0;
  double center_sigma = 0.0;
  // Of kBody: of camera_from_body; and the camera's centre on the body, in units of a, with its worst sigma.
  double mount_sigma_rad = 0.0;
  Vector3d camera_in_body = Vector3d::Zero();
  double camera_in_body_sigma = 0.0;
  // Noise found (or given), per axis.
  double sigma_position = 0.0;
  double sigma_rotation_rad = 0.0;
  double spread = 0.0;  // RMS distance of a's positions to their centre, pairs that fit only
  // Per pair: what is left, and whether it fits (within 5 sigma of both kinds that are used).
  std::vector<double> position_error;
  std::vector<double> rotation_error_rad;  // with the mount; means nothing where orientations do not
  std::vector<bool> fits;
  int fit_count = 0;
  double rmse_all = 0.0;  // of the positions
  double rmse_fits = 0.0;

  double RelativeScaleSigma() const { return scale_sigma / a_from_b.scale(); }
};

// Pairs in the order of time, no preference in frame units. A poor result is a result: ask CheckDetermined and
// CheckFits. Errors: InvalidArgument for spans of different sizes, numbers that are not finite and bad options;
// FailedPrecondition for fewer than 3 pairs or positions that all coincide in one of the sets.
absl::StatusOr<PoseAlignment> AlignPoses(std::span<const SE3> poses_a, std::span<const SE3> poses_b,
                                         const PoseAlignmentOptions& options = {});

struct PoseAlignmentLimits {
  double max_relative_scale_sigma = 0.10;
  double max_rotation_sigma_rad = 0.0174532925;  // 1 deg
  // Share of the pairs that must fit; the second where orientations that turn contradict the camera's.
  double min_fit_share = 0.6;
  double min_fit_share_contradicted = 0.8;
};

// FailedPrecondition names what the pairs leave open, by how much, and what would determine it.
absl::Status CheckDetermined(const PoseAlignment& alignment, const PoseAlignmentLimits& limits = {});

// FailedPrecondition if so many pairs do not fit that the two sets are hardly of one camera: fewer than the share
// above, or more coordinates thrown away than those that are left prove (3 per pair, without the 7 that are fitted).
absl::Status CheckFits(const PoseAlignment& alignment, const PoseAlignmentLimits& limits = {});

}  // namespace cairn
