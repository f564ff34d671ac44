// Relative pose error: how far the motion between two times, a given distance (or number of frames, or time) apart, is
// from the true one; drift, without the effect of one early error on everything after it. Sturm et al., "A benchmark
// for the evaluation of RGB-D SLAM systems" (IROS 2012), Eq. 2; over distances as in Geiger et al., "Are we ready for
// autonomous driving? The KITTI vision benchmark suite" (CVPR 2012).
#pragma once

#include <span>
#include <vector>

#include "eval/statistics.h"
#include "geometry/orientation_agreement.h"
#include "io/trajectory.h"

namespace cairn::eval {

enum class RpeUnit { kFrames, kMeters, kSeconds };

struct RpeOptions {
  RpeUnit unit = RpeUnit::kMeters;
  // Lengths of the segments in the unit above; one result each. Metres are counted along the true path.
  std::vector<double> deltas = {1.0};
  // The scale of the estimate is taken from its Sim(3) alignment over all of it. False: as it is.
  bool with_scale = true;
  double max_dt_s = 0.02;  // association, as for the ATE

  absl::Status Validate() const;
};

struct RpeResult {
  double delta = 0.0;
  Statistics translation_m;
  Statistics rotation_rad;
  // Mean translation error over the segment's true length: drift in percent. 0 where nothing moves.
  double drift_percent = 0.0;
  int segments = 0;  // 0: the trajectory is shorter than delta
};

struct RpeResults {
  // Of the ground truth. A body's are turned to the camera's first; where they mean nothing, the estimate's stand in:
  // then `rotation_rad` is empty, and translations are those of the positions.
  OrientationAgreement orientations;
  std::vector<RpeResult> per_delta;
};

// Segments start at every associated pose and end at the first pose at least `delta` later.
// Errors: as EvaluateAte.
absl::StatusOr<RpeResults> EvaluateRpe(std::span<const io::StampedPose> estimate,
                                       std::span<const io::StampedPose> groundtruth, const RpeOptions& options = {});

}  // namespace cairn::eval
