// Bundle adjustment: poses and points that minimize the reprojection error of all observations (eq. "reproj_error",
// Sec. V-C of Lee and Civera, "Loosely-Coupled Semi-Direct Monocular SLAM"; Triggs et al., "Bundle adjustment - a
// modern synthesis", 2000). Knows nothing of maps: flat arrays in, flat arrays out.
//
// Levenberg-Marquardt with Schur complement on one thread: with few free poses in optimization/schur_solver.h, with
// many in Ceres with SuiteSparse. Derivatives by hand (optimization/reprojection.h), left increments of
// camera_from_map. Two rounds: with Huber's loss first; then observations beyond the chi-square threshold, or behind
// their camera, are dropped and the rest is adjusted without it. On request two more with the noise that the first two
// left to be seen: Huber's loss at the spread that the residuals have, and then with rotations known from elsewhere,
// weighted by how they disagree with the images (optimization/bundle_noise.h).
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "base/status.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "optimization/reprojection.h"

namespace cairn::optimization {

struct BundlePose {
  SE3 camera_from_map;
  std::uint32_t camera = 0;  // index into BundleProblem::cameras
  bool fixed = false;
};

struct BundleObservation {
  std::uint32_t pose = 0;
  std::uint32_t point = 0;
  Vector2d pixel = Vector2d::Zero();
  double sigma_px = 1.0;  // scale_factor^octave
};

// What is known of a pose besides the observations.
struct BundlePrior {
  std::uint32_t pose = 0;
  SE3 camera_from_map;
  double position_sigma = 0.0;      // of the camera's centre, per axis, in map units
  double rotation_sigma_rad = 0.0;  // per axis
};

// A rotation between two poses that something else has measured. How well, AdjustBundle() finds out: only relative to
// the problem's other rotations is it given.
struct BundleRotation {
  std::uint32_t pose_a = 0;
  std::uint32_t pose_b = 0;
  Quaterniond b_from_a = Quaterniond::Identity();
  double steps = 1.0;  // its variance is so many times that of a single step of the measurement
};

struct BundleProblem {
  std::vector<Pinhole> cameras;
  std::vector<BundlePose> poses;
  std::vector<Vector3d> points;  // in the map frame; points with fewer than two observations stay as they are
  std::vector<BundleObservation> observations;
  std::vector<BundlePrior> priors;
  std::vector<BundleRotation> rotations;  // take part if BundleAdjustmentOptions::noise_iterations allow it
};

struct BundleAdjustmentOptions {
  int first_iterations = 5;                   // with Huber's loss
  int second_iterations = 10;                 // without, on the inliers; 0: one round only
  double chi2_threshold = kChiSquarePixel95;  // of a whitened residual: inlier up to here
  double huber_threshold = 2.4477;            // sqrt(5.991), whitened
  int noise_iterations = 0;                   // of each round with the measured noise; 0: none of them
  int max_dense_poses = 60;                   // free poses up to which the dense solver is used
  double function_tolerance = 1e-4;           // a round ends when the cost falls by less than this share
  // Looked at after every iteration, from any thread's store; may be null. Once true, the adjustment ends with what it
  // has and `interrupted` set.
  const std::atomic<bool>* stop = nullptr;

  absl::Status Validate() const;
};

struct BundleResult {
  std::vector<SE3> camera_from_map;  // per pose
  std::vector<Vector3d> points;
  std::vector<std::uint8_t> inlier;  // per observation, 1 or 0
  int num_inliers = 0;
  double initial_cost = 0.0;        // half the sum of squared whitened residuals under Huber's loss
  double final_cost = 0.0;          // half the sum of squared whitened residuals of the inliers
  double inlier_rmse = 0.0;         // root mean square of the inliers' whitened residuals, both directions together
  int iterations = 0;               // successful steps of all rounds
  double noise_px = 0.0;            // of an observation per axis, over its sigma_px; 0: not measured
  double rotation_noise_rad = 0.0;  // per axis, of one step of the rotations; 0: none took part
  bool interrupted = false;         // by options.stop
};

// InvalidArgument: indices out of range, values that are not finite, sigmas that are not positive. FailedPrecondition:
// no pose is fixed or has a prior (the problem would float), or nothing is free.
absl::Status CheckProblem(const BundleProblem& problem);

// As CheckProblem(). InvalidArgument: bad options. Internal: the solver failed.
absl::StatusOr<BundleResult> AdjustBundle(const BundleProblem& problem, const BundleAdjustmentOptions& options = {});

}  // namespace cairn::optimization
