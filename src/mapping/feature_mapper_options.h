// The settings of the feature module, with defaults for every sequence. Sections refer to Lee and Civera,
// "Loosely-Coupled Semi-Direct Monocular SLAM" (RA-L 2019), called LCSD below; thresholds of local mapping to
// Mur-Artal, Montiel and Tardos, "ORB-SLAM" (T-RO 2015).
#pragma once

#include "absl/status/status.h"
#include "mapping/lens_refinement.h"
#include "tracking/local_map_tracker.h"

namespace cairn::mapping {

// A keyframe goes if more than this share of its points is seen in so many others (culling.h).
struct Redundancy {
  double share = 0.0;
  int observers = 0;
};

struct FeatureMapperOptions {
  // Features per keyframe by the rate at which the direct module makes keyframes: linear in between (LCSD Sec. V-B).
  int max_features = 2500;
  int min_features = 1500;
  double slow_rate_hz = 4.0;
  double fast_rate_hz = 7.0;

  // Start from direct depths.
  int min_start_points = 100;    // features with a trustworthy depth at the first start ...
  int min_restart_points = 150;  // ... and at a later one, after a loss

  // Tracking of a keyframe against the local map; with fewer than its min_inliers the keyframe is lost.
  tracking::LocalMapTrackerOptions tracker;
  int poor_inliers = 60;  // fewer: the state is poor

  // Standard deviations of direct odometry from one keyframe to the next, per axis: a share of the motion and of its
  // rotation, and a share of the median scene depth and as many radians. They weigh in where matches are few.
  double odometry_sigma_share = 0.05;
  double odometry_sigma_depth = 0.003;

  // Insertion (LCSD Sec. V-D).
  int insert_below_matches = 150;
  int max_keyframes_between = 3;     // packets not inserted in a row ...
  double max_seconds_between = 0.5;  // ... and the time they may take, by the rate of keyframes
  double insert_below_share = 0.75;  // of the matches of the last keyframe inserted

  // New points.
  int triangulation_neighbours = 6;
  // So many points in one of 8 x 8 cells of the image, first seen so many keyframes ago: no further ones are made
  // there.
  int covered_points = 8;  // 0: no limit
  int covered_age = 10;
  double min_parallax_deg = 1.0;
  double min_baseline_share = 0.01;  // of the median scene depth, between two keyframes
  double max_chi_square = 5.991;     // of a reprojection error, 2 degrees of freedom, 95 %

  // Fusion of duplicate points.
  int fusion_neighbours = 15;
  int fusion_second_neighbours = 5;
  double fusion_radius_px = 3.0;

  // Local bundle adjustment; half of the usual iterations (LCSD Sec. VI-A).
  int max_adjusted_keyframes = 10;
  int max_fixed_keyframes = 15;
  int first_iterations = 3;
  int second_iterations = 5;

  // At the end of a session: a bundle adjustment of all that it added, if it has no more keyframes than this (0:
  // never).
  int max_final_keyframes = 400;
  double final_tolerance = 1e-6;  // a round of it ends when the cost falls by less than this share
  int final_iterations = 30;
  int noise_iterations =
      30;  // of it by the noise that the observations show, and with the odometry's rotations; 0: none

  // ... after which it says whether the camera is as calibrated.
  LensRefinementOptions lens;

  // Culling.
  double min_found_ratio = 0.25;  // of a new point, and of any that was to be seen as often as ...
  int judged_after = 20;          // ... this
  int min_observations = 3;       // of a point that is older than ...
  int young_keyframes = 3;        // ... this many keyframes
  Redundancy redundancy = {0.75, 3};
  // Of a session's own keyframes at its end, where others have been: what the map has seen before needs no third view.
  // Five visits to a rendered office keep 1.8 x the keyframes of the first (2.6 x by the rule above), and are about as
  // accurate. Culling the others' keyframes as well saves as much, and costs more.
  Redundancy redundancy_of_visits = {0.8, 2};

  // After a loss.
  int max_attempts = 5;  // keyframes that try to find the map again before a new start is made from direct depths

  absl::Status Validate() const;
};

}  // namespace cairn::mapping
