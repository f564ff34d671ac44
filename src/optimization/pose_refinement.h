// Motion-only bundle adjustment: the pose of one camera from 2D-3D matches with fixed points (Sec. V-C of
// "Loosely-Coupled Semi-Direct Monocular SLAM").
//
// Levenberg-Marquardt on the six degrees of freedom, Huber's loss on residuals whitened by sigma_px, in rounds: after
// each round every observation is classified anew by chi-square, and the next round uses the inliers only.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "optimization/reprojection.h"

namespace cairn::optimization {

struct PoseObservation {
  Vector3d point = Vector3d::Zero();  // in the map frame
  Vector2d pixel = Vector2d::Zero();  // measured, in the undistorted image
  double sigma_px = 1.0;              // scale_factor^octave of the keypoint
};

// What is known of the pose before: by odometry, say. Independent standard deviations per axis of the left increment
// Exp(x) prior, x = (translation, rotation): in map units, and in radians.
struct PosePrior {
  SE3 camera_from_map;
  double translation_sigma = 0.0;
  double rotation_sigma_rad = 0.0;
};

struct PoseRefinementOptions {
  int rounds = 4;
  int iterations_per_round = 10;              // ends earlier when the step vanishes
  double chi2_threshold = kChiSquarePixel95;  // of a whitened residual: inlier up to here
  double huber_threshold = 2.4477;            // sqrt(5.991), whitened
  int min_observations = 4;                   // fewer inliers than this at any time: no answer

  std::optional<PosePrior> prior;

  absl::Status Validate() const;
};

struct PoseRefinement {
  SE3 camera_from_map;
  std::vector<std::uint8_t> inlier;  // per observation, 1 or 0; points behind the camera are 0
  int num_inliers = 0;
  double chi2 = 0.0;  // sum of the inliers' squared whitened residuals
  // Of (translation, rotation) as a left increment of camera_from_map, in map units and radians: the inverse of the
  // inliers' normal matrix, times the variance factor chi2 / (2 n - 6) where that is above 1.
  Matrix6d covariance = Matrix6d::Zero();
};

// InvalidArgument: bad options, an observation that is not finite or has no positive sigma. FailedPrecondition: fewer
// than min_observations (or inliers after a round), or a geometry that leaves the pose undetermined.
absl::StatusOr<PoseRefinement> RefinePose(const Pinhole& pinhole, const SE3& initial_camera_from_map,
                                          std::span<const PoseObservation> observations,
                                          const PoseRefinementOptions& options = {});

// The covariance of map_from_camera as a left increment, from that of camera_from_map.
Matrix6d CovarianceOfInverse(const SE3& camera_from_map, const Matrix6d& covariance);

}  // namespace cairn::optimization
