// Bundle adjustment of a part of the map, in an Edit: the keyframes given move, all their points move, every other
// keyframe that sees these points holds them in place.
#pragma once

#include <span>
#include <vector>

#include "base/status.h"
#include "map/edit.h"
#include "optimization/bundle_adjustment.h"

namespace cairn::mapping {

// What is known of the pose of a keyframe besides its observations.
struct KeyframePrior {
  KeyframeId keyframe;
  SE3 camera_from_map;
  double position_sigma = 0.0;  // of the camera's centre, per axis, map units
  double rotation_sigma_rad = 0.0;
};

// A rotation between two keyframes as the odometry measured it, over so many of its own keyframes.
struct KeyframeRotation {
  KeyframeId a;
  KeyframeId b;
  Quaterniond b_from_a = Quaterniond::Identity();
  int steps = 1;
};

struct LocalAdjustmentOptions {
  int first_iterations = 3;
  int second_iterations = 5;
  // Of each round by the noise that the observations show, and with `rotations`
  // (optimization/bundle_adjustment.h); 0: none of them.
  int noise_iterations = 0;
  double function_tolerance = 1e-4;         // a round ends when the cost falls by less than this share
  int max_fixed_keyframes = 30;             // those that see most of the points; 0: all
  bool hold_poses = false;                  // only points move
  std::vector<KeyframePrior> priors;        // of the free keyframes; they anchor the map like fixed ones
  std::vector<KeyframeRotation> rotations;  // in temporal order; those of keyframes that take no part are left out
};

struct LocalAdjustmentReport {
  bool adjusted = false;  // false: there was nothing to adjust
  int keyframes = 0;
  int fixed_keyframes = 0;
  int points = 0;
  int observations = 0;
  int rejected_observations = 0;
  int iterations = 0;
  double rmse = 0.0;                // of whitened inlier residuals
  double noise_px = 0.0;            // of an observation at octave 0, per axis; 0: not measured
  double rotation_noise_rad = 0.0;  // of one step of the rotations, per axis; 0: none took part
};

// The new keyframe and its best covisible neighbours, at most `max_count`, without those held against `session`
// (mapping/held.h).
std::vector<KeyframeId> KeyframesToAdjust(const map::Edit& edit, KeyframeId keyframe, int max_count, SessionId session);

// `free` are the keyframes to move. If no other keyframe sees their points, the oldest of them is held: it anchors the
// map. Observations that turn out wrong are removed, points with fewer than two left are erased.
absl::StatusOr<LocalAdjustmentReport> AdjustKeyframes(map::Edit& edit, std::span<const KeyframeId> free,
                                                      const LocalAdjustmentOptions& options = {});

}  // namespace cairn::mapping
