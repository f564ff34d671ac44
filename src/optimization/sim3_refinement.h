// The similarity between two cameras whose maps have drifted apart, from points that both maps hold (Mur-Artal,
// Montiel, Tardos, "ORB-SLAM", T-RO 2015, Sec. VII-B; Horn, "Closed-form solution of absolute orientation using unit
// quaternions", JOSA A 1987, for the samples).
//
// Errors of a match, all whitened: the reprojection of the point of b in camera a, that of the point of a in camera b,
// and the logarithm of the ratio of the point's distances from camera a as either map has it. The two reprojections
// know the scale only through the baseline (they fix t / s and t); two views from nearly the same place would leave it
// open, the distances do not. Knows nothing of maps: flat arrays in and out.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::optimization {

using Matrix27d = Eigen::Matrix<double, 2, 7>;

// Chi-square at 99 % for two dimensions.
inline constexpr double kChiSquarePixel99 = 9.210;

struct Sim3Match {
  // The point in the frame of camera a as map a has it, and in the frame of camera b as map b has it.
  Vector3d point_a = Vector3d::Zero();
  Vector3d point_b = Vector3d::Zero();
  Vector2d pixel_a = Vector2d::Zero();  // measured in camera a
  Vector2d pixel_b = Vector2d::Zero();
  double sigma_a_px = 1.0;  // scale_factor^octave
  double sigma_b_px = 1.0;
  bool has_point_a = true;  // false: only the point of b is known
  bool has_pixel_b = true;  // false: camera b did not measure it
};

// Derivatives by the left increment (translation, rotation, log scale) of a_from_b.
// Of the residual project(a_from_b * point_b) - pixel_a, at point_a = a_from_b * point_b.
Matrix27d ForwardReprojectionBySim3(const Pinhole& pinhole_a, const Vector3d& point_a);
// Of the residual project(a_from_b^-1 * point_a) - pixel_b.
Matrix27d BackwardReprojectionBySim3(const Pinhole& pinhole_b, const Sim3& a_from_b, const Vector3d& point_a);
// Of log |a_from_b * point_b| - log |point_a|, at moved = a_from_b * point_b.
Eigen::Matrix<double, 1, 7> LogDistanceBySim3(const Vector3d& moved);

// Squared whitened residuals of the two reprojections; infinite behind a camera, 0 for what the match does not have.
struct Sim3ChiSquares {
  double in_a = 0.0;
  double in_b = 0.0;
  bool Within(double threshold) const { return in_a <= threshold && in_b <= threshold; }
};
Sim3ChiSquares ChiSquaresOf(const Pinhole& pinhole_a, const Pinhole& pinhole_b, const Sim3& a_from_b,
                            const Sim3Match& match);

struct Sim3RansacOptions {
  int max_samples = 300;
  double confidence = 0.999;                  // of having seen a sample of inliers, at which sampling ends
  double chi2_threshold = kChiSquarePixel99;  // of either reprojection
  int min_inliers = 20;
  std::uint64_t seed = 1;

  absl::Status Validate() const;
};

struct Sim3RefinementOptions {
  int rounds = 3;  // inliers are told anew after each
  int iterations_per_round = 10;
  double chi2_threshold = kChiSquarePixel99;
  double huber_threshold = 3.0348;   // sqrt(9.210), whitened
  double min_distance_sigma = 0.01;  // of the log distances; the robust spread of the matches, but at least this
  int min_inliers = 10;

  absl::Status Validate() const;
};

struct Sim3Estimate {
  Sim3 a_from_b;
  std::vector<std::uint8_t> inlier;  // per match, 1 or 0
  int num_inliers = 0;
};

// The best of the similarities that three matches give, by the number of inliers. Uses only matches with both points;
// others are judged as well. InvalidArgument: bad options or matches that are not finite. FailedPrecondition: fewer
// than min_inliers agree.
absl::StatusOr<Sim3Estimate> FindSim3(const Pinhole& pinhole_a, const Pinhole& pinhole_b,
                                      std::span<const Sim3Match> matches, const Sim3RansacOptions& options = {});

// Levenberg-Marquardt on the seven degrees of freedom with Huber's loss. Errors as FindSim3, and FailedPrecondition
// when no match has both points: nothing would tell the scale.
absl::StatusOr<Sim3Estimate> RefineSim3(const Pinhole& pinhole_a, const Pinhole& pinhole_b,
                                        const Sim3& initial_a_from_b, std::span<const Sim3Match> matches,
                                        const Sim3RefinementOptions& options = {});

}  // namespace cairn::optimization
