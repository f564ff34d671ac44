// A small bundle adjustment of corners over a few views, for the start: inverse depths anchored at pixels of the
// reference view, poses of the other views, Levenberg-Marquardt with the Schur complement over the depths, Huber loss
// on pixels.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::direct {

struct StructureProblem {
  Pinhole camera;
  std::vector<Vector2d> reference_px;              // one per point, taken as exact
  std::vector<double> inverse_depth;               // one per point, in the reference; in and out
  std::vector<SE3> camera_from_reference;          // one per view, the reference itself not among them; in and out
  std::vector<std::vector<Vector2d>> observed_px;  // [view][point]; NaN: not observed
};

struct StructureReport {
  double rms_px = 0.0;        // of the inlier observations
  double inlier_share = 0.0;  // of points with a mean error below 2 Huber thresholds and a positive depth
  std::vector<bool> inlier;   // per point
  std::vector<double>
      relative_depth_sigma;  // per point, standard deviation of inverse depth over inverse depth, 1 px noise
};

inline constexpr double kStructureHuberPx = 1.0;

// Moves one view only; the depths stay. The result of the last residuals is the root mean square error in pixels.
double AlignView(const StructureProblem& problem, const std::vector<Vector2d>& observed_px, int iterations, SE3* pose);

// Moves everything; the scale stays where damping leaves it.
StructureReport AdjustStructure(int iterations, StructureProblem* problem);

// Moves the depths only, each by itself.
StructureReport AdjustDepths(int iterations, StructureProblem* problem);

// Residual (2) and its derivatives by the left increment of camera_from_reference (2x6) and by the inverse depth (2).
// False behind the camera.
bool StructureResidual(const Pinhole& camera, const Vector2d& reference_px, double inverse_depth, const SE3& pose,
                       const Vector2d& observed_px, Vector2d* residual, Eigen::Matrix<double, 2, 6>* by_pose,
                       Vector2d* by_depth);

}  // namespace cairn::direct
