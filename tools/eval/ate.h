// Absolute trajectory error: the distance of each estimated position to the ground truth after one similarity (or
// rigid) transform for the whole trajectory. Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems" (IROS
// 2012), with the alignment of Umeyama (PAMI 1991).
#pragma once

#include <span>
#include <vector>

#include "eval/statistics.h"
#include "geometry/orientation_agreement.h"
#include "geometry/se3.h"
#include "io/trajectory.h"

namespace cairn::eval {

struct AteOptions {
  // A pose takes the nearest ground-truth sample if that is not further away in time: half a frame.
  double max_dt_s = 0.02;
  // False: rigid alignment, for trajectories that claim to be metric.
  bool with_scale = true;
  // False: no alignment at all, for poses that claim to be in the ground truth's frame already.
  bool align = true;

  absl::Status Validate() const;
};

struct AtePose {
  TimeNs time_ns = 0;
  SE3 aligned;      // world_from_camera of the estimate, in the ground truth's frame
  SE3 groundtruth;  // of the associated sample
  double error_m = 0.0;
  double rotation_error_rad = 0.0;  // 0 where orientations mean nothing
};

struct AteResult {
  Sim3 groundtruth_from_estimate;
  double scale_sigma = 0.0;  // standard deviation of its scale
  Statistics position_m;
  // What the orientations of the ground truth are. If they are a body's, its constant rotation against the camera is
  // not counted as an error.
  OrientationAgreement orientations;
  // Angle between aligned and true orientation, where the alignment is that of positions and orientations together
  // (geometry/pose_alignment.h): positions on a line leave a roll open. Empty where orientations mean nothing.
  Statistics rotation_rad;
  double path_length_m = 0.0;  // of the ground truth over the time of the estimate
  int estimated = 0;           // poses given, of which position_m.count have ground truth
  std::vector<AtePose> poses;  // in the order of time
};

// Errors: FailedPrecondition if fewer than 3 poses have ground truth or all of them lie on a line; InvalidArgument for
// bad options.
absl::StatusOr<AteResult> EvaluateAte(std::span<const io::StampedPose> estimate,
                                      std::span<const io::StampedPose> groundtruth, const AteOptions& options = {});

}  // namespace cairn::eval
