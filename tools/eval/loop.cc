#include "eval/loop.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/alignment.h"
#include "geometry/pose_association.h"

namespace cairn::eval {

absl::Status LoopOptions::Validate() const {
  if (!(max_dt_s >= 0.0) || max_dt_s > 1e6) {
    return absl::InvalidArgumentError(absl::StrCat("max_dt_s must be a number of seconds >= 0, is ", max_dt_s));
  }
  if (min_segment_poses < 3) return absl::InvalidArgumentError("min_segment_poses must be at least 3");
  return absl::OkStatus();
}

namespace {

struct Segments {
  std::vector<io::StampedPose> start;
  std::vector<io::StampedPose> end;
};

Segments SplitByRow(const io::Trajectory& groundtruth) {
  Segments segments;
  for (std::size_t i = 0; i < groundtruth.poses.size(); ++i) {
    (groundtruth.rows[i] < groundtruth.num_rows / 2 ? segments.start : segments.end).push_back(groundtruth.poses[i]);
  }
  return segments;
}

Segments SplitByGap(std::span<const io::StampedPose> groundtruth) {
  const std::vector<io::StampedPose> sorted = SortedFinite(groundtruth);
  std::size_t split = 0;
  TimeNs longest_ns = 0;
  for (std::size_t i = 1; i < sorted.size(); ++i) {
    const TimeNs gap_ns = sorted[i].time_ns - sorted[i - 1].time_ns;
    if (gap_ns > longest_ns) {
      longest_ns = gap_ns;
      split = i;
    }
  }
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(split);
  return {{sorted.begin(), middle}, {middle, sorted.end()}};
}

absl::StatusOr<Alignment> AlignSegment(std::span<const io::StampedPose> estimate,
                                       std::span<const io::StampedPose> groundtruth, const LoopOptions& options,
                                       absl::string_view name) {
  const std::vector<io::StampedPose> gt = SortedFinite(groundtruth);
  std::vector<Vector3d> true_points, estimated_points;
  for (const Association& pair : AssociateNearest(estimate, gt, options.max_dt_s)) {
    true_points.push_back(gt[pair.groundtruth].world_from_camera.translation());
    estimated_points.push_back(estimate[pair.estimate].world_from_camera.translation());
  }
  if (static_cast<int>(true_points.size()) < options.min_segment_poses) {
    return absl::FailedPreconditionError(absl::StrCat("only ", true_points.size(), " poses have ground truth in the ",
                                                      name, " segment (within ", options.max_dt_s, " s), need ",
                                                      options.min_segment_poses));
  }
  auto alignment = AlignPoints(true_points, estimated_points);
  if (!alignment.ok()) return Annotate(alignment.status(), absl::StrCat("aligning to the ", name, " segment"));
  return alignment;
}

}  // namespace

absl::StatusOr<LoopResult> EvaluateLoop(std::span<const io::StampedPose> estimate, const io::Trajectory& groundtruth,
                                        const LoopOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (groundtruth.rows.size() != groundtruth.poses.size()) {
    return absl::InvalidArgumentError("the ground truth must give the row of each pose");
  }
  const std::vector<io::StampedPose> est = SortedFinite(estimate);
  const Segments segments = groundtruth.num_nan_rows() > 0 ? SplitByRow(groundtruth) : SplitByGap(groundtruth.poses);
  CAIRN_ASSIGN_OR_RETURN(const Alignment start, AlignSegment(est, segments.start, options, "start"));
  CAIRN_ASSIGN_OR_RETURN(const Alignment end, AlignSegment(est, segments.end, options, "end"));

  LoopResult result;
  result.world_from_estimate_start = start.a_from_b;
  result.world_from_estimate_end = end.a_from_b;
  result.start_rmse_m = start.rmse;
  result.end_rmse_m = end.rmse;
  result.start_poses = start.inlier_count;
  result.end_poses = end.inlier_count;
  double sum = 0.0;
  for (const io::StampedPose& pose : est) {
    const Vector3d& p = pose.world_from_camera.translation();
    sum += (start.a_from_b * p - end.a_from_b * p).squaredNorm();
  }
  result.align_error_m = std::sqrt(sum / static_cast<double>(est.size()));
  const Sim3 drift = end.a_from_b * start.a_from_b.Inverse();
  result.rotation_drift_rad = AngleRad(drift.rotation());
  result.scale_drift = std::max(drift.scale(), 1.0 / drift.scale());
  return result;
}

}  // namespace cairn::eval
