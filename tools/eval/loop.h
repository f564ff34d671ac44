// The TUM monoVO protocol: ground truth exists only where the sequence starts and where it ends, in one frame, because
// it ends where it started; the drift in between is how far the trajectory aligned to the start is from the trajectory
// aligned to the end. Engel, Usenko, Cremers, "A photometrically calibrated benchmark for monocular visual odometry"
// (arXiv:1607.02555, 2016), Sec. 5.
#pragma once

#include <span>

#include "base/status.h"
#include "geometry/se3.h"
#include "io/trajectory.h"

namespace cairn::eval {

struct LoopOptions {
  double max_dt_s = 0.001;    // association of keyframes and ground truth
  int min_segment_poses = 4;  // in each of the two segments

  absl::Status Validate() const;
};

struct LoopResult {
  double align_error_m = 0.0;  // e_align: RMSE between the two aligned copies of the whole trajectory
  Sim3 world_from_estimate_start;
  Sim3 world_from_estimate_end;
  double start_rmse_m = 0.0;  // of each alignment
  double end_rmse_m = 0.0;
  int start_poses = 0;
  int end_poses = 0;
  // The drift between the two, of the Sim(3) that takes one copy to the other: rotation, and scale as max(s, 1/s) >= 1.
  double rotation_drift_rad = 0.0;
  double scale_drift = 1.0;
};

// The file's middle row separates the two segments; a ground truth without empty (NaN) rows is split at its longest gap
// in time instead. Errors: FailedPrecondition if a segment has too few poses; by the protocol such a run counts as
// infinity.
absl::StatusOr<LoopResult> EvaluateLoop(std::span<const io::StampedPose> estimate, const io::Trajectory& groundtruth,
                                        const LoopOptions& options = {});

}  // namespace cairn::eval
