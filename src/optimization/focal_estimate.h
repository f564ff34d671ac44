// Whether a located camera is calibrated as it says: its 2D-3D matches, once there are a few dozen of them at different
// depths, tell its focal length as well as its pose. A focal length that is 20 % off hides in the pose, which comes to
// lie nearer or further away, at a covariance of millimetres: the matches fit nearly as well.
//
// Minimizes the reprojection errors over the pose and the logarithm of one factor on both focal lengths (the principal
// point stays), by Levenberg-Marquardt with Huber's loss, in rounds as RefinePose() does.
#pragma once

#include <span>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "optimization/pose_refinement.h"

namespace cairn::optimization {

struct FocalEstimate {
  double scale = 1.0;      // what the calibration's focal lengths are to be multiplied by
  double log_sigma = 0.0;  // standard deviation of its logarithm
  SE3 camera_from_map;     // the pose with it
  int num_inliers = 0;

  // Whether the matches contradict the calibration: by more than five standard deviations, and more than lenses that
  // were calibrated with some care differ (2 %).
  bool Contradicts() const;
};

// `observations` are all matches, those that the pose with the calibration as it is calls outliers too: a wrong focal
// length makes outliers at the border of the image. InvalidArgument as RefinePose(); FailedPrecondition for fewer than
// 30 matches that agree, or a geometry that leaves the focal length undetermined.
absl::StatusOr<FocalEstimate> EstimateFocal(const Pinhole& pinhole, const SE3& camera_from_map,
                                            std::span<const PoseObservation> observations,
                                            const PoseRefinementOptions& options = {});

// The covariance of a pose from the calibration as it is, made to cover the one with the estimated focal length: the
// difference between the two counts as one standard deviation. As a left increment of camera_from_map.
Matrix6d CoverFocal(const SE3& camera_from_map, const Matrix6d& covariance, const FocalEstimate& estimate);

}  // namespace cairn::optimization
