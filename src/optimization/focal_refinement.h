// Whether an image's calibration fits what it shows of a map: the pose of its camera together with one factor of its
// focal length, from 2D-3D matches with fixed points. With a focal length that is wrong, a pose can be found that
// explains most matches, at a wrong distance; free, the focal length leaves less, and says by how much it is off.
//
// Gauss-Newton on seven unknowns: a left increment of camera_from_map as in reprojection.h, and the logarithm of the
// factor, by which the residual changes as projection - principal point. Huber's loss on whitened residuals.
#pragma once

#include <span>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "optimization/pose_refinement.h"

namespace cairn::optimization {

struct FocalRefinement {
  double factor = 1.0;        // of both focal lengths
  double factor_sigma = 0.0;  // standard deviation, by the noise that the residuals show
  SE3 camera_from_map;        // with that focal length
  double chi2 = 0.0;          // of the residuals within Huber's limit with the factor, whitened
  double chi2_before = 0.0;   // likewise without it
};

// FailedPrecondition: fewer than eight observations, or a geometry that leaves the focal length open (a plane seen
// frontally, far points only).
absl::StatusOr<FocalRefinement> RefineFocal(const Pinhole& pinhole, const SE3& camera_from_map,
                                            std::span<const PoseObservation> observations);

}  // namespace cairn::optimization
