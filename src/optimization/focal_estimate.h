// Whether a located camera is calibrated as it says: its 2D-3D matches, once there are a few dozen of them at different
// depths, tell its focal length and principal point as well as its pose. A focal length that is 20 % off hides in the
// pose, which comes to lie nearer or further away, at a covariance of millimetres: the matches fit nearly as well.
//
// Minimizes the reprojection errors over the pose, the logarithm of one factor on both focal lengths and a shift of the
// principal point, by Levenberg-Marquardt with Huber's loss, in rounds as RefinePose() does.
#pragma once

#include <span>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "optimization/pose_refinement.h"

namespace cairn::optimization {

// What a calibration is thought to err by before the matches are asked. The focal length so much that they decide
// wherever they can; the principal point not at all, unless that is the question: a shutter that rolls and a map that
// is bent move it by some per cent in a good image, and the focal length with it.
struct FocalPrior {
  double log_focal_sigma = 0.5;   // of the logarithm of the focal lengths
  double principal_sigma = 1e-4;  // of the principal point, share of the image's longer side

  static FocalPrior WithPrincipalPoint() { return {0.5, 0.15}; }
};

// Maps that are bent a little, and shutters that roll, move what single images show by so much (one standard deviation;
// of the principal point in a handheld recording with a rolling shutter up to 0.066 in 92 images).
inline constexpr double kUsualFocalError = 0.0075;
inline constexpr double kUsualPrincipalError = 0.016;

struct FocalEstimate {
  double scale = 1.0;                           // what the calibration's focal lengths are to be multiplied by
  double log_sigma = 0.0;                       // standard deviation of its logarithm
  Vector2d principal_shift = Vector2d::Zero();  // of the principal point, share of the image's longer side ...
  Vector2d principal_sigma = Vector2d::Zero();  // ... and its standard deviations
  SE3 camera_from_map;                          // the pose with both
  // How the pose with the calibration as it is goes with the two: its left increment by (log focal, shift).
  Eigen::Matrix<double, 6, 3> by_calibration = Eigen::Matrix<double, 6, 3>::Zero();
  int num_inliers = 0;

  // The calibration as it should be.
  Pinhole Corrected(const Pinhole& pinhole) const;
  // Whether the matches contradict the calibration: by more than five standard deviations, their own and those by which
  // maps that are bent a little move what single images show.
  bool Contradicts() const { return FocalContradicts() || PrincipalContradicts(); }
  bool FocalContradicts() const;
  bool PrincipalContradicts() const;
  // Whether it is off by more than usual: three standard deviations, and more than what maps err.
  bool Doubts() const;
};

// `observations` are all matches, those that the pose with the calibration as it is calls outliers too: a wrong focal
// length makes outliers at the border of the image. InvalidArgument as RefinePose(); FailedPrecondition for fewer than
// 15 matches that agree, or a geometry that leaves the pose undetermined. Where it leaves the calibration undetermined
// the standard deviations say so.
absl::StatusOr<FocalEstimate> EstimateFocal(const Pinhole& pinhole, const SE3& camera_from_map,
                                            std::span<const PoseObservation> observations,
                                            const PoseRefinementOptions& options = {}, const FocalPrior& prior = {});

// The covariance of a pose from the calibration as it is, made to cover what the matches say of that: where they doubt
// it or say next to nothing of it, the difference between the two poses as one standard deviation; where they leave it
// open, how the pose would go with a calibration that is wrong by as much as they allow, up to what calibrations err at
// worst (five standard deviations cover half of the right focal length). As a left increment of camera_from_map.
Matrix6d CoverFocal(const SE3& camera_from_map, const Matrix6d& covariance, const FocalEstimate& estimate);

}  // namespace cairn::optimization
