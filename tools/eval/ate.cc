#include "eval/ate.h"

#include <cmath>

#include "eval/reference.h"
#include "geometry/alignment.h"
#include "geometry/pose_alignment.h"
#include "geometry/pose_association.h"

namespace cairn::eval {
namespace {

double PathLength(std::span<const io::StampedPose> groundtruth, TimeNs from_ns, TimeNs to_ns) {
  double length_m = 0.0;
  const io::StampedPose* previous = nullptr;
  for (const io::StampedPose& pose : groundtruth) {
    if (pose.time_ns < from_ns || pose.time_ns > to_ns) continue;
    if (previous != nullptr) {
      length_m += (pose.world_from_camera.translation() - previous->world_from_camera.translation()).norm();
    }
    previous = &pose;
  }
  return length_m;
}

// Angle of each pair; nothing where orientations mean nothing.
std::vector<double> RotationErrors(const PairedPoses& poses, const AteOptions& options,
                                   OrientationAgreement* orientations) {
  if (options.align) {
    const auto alignment = AlignPoses(poses.groundtruth, poses.estimate, {.with_scale = options.with_scale});
    if (!alignment.ok()) return {};
    *orientations = alignment->orientations;
    return alignment->orientations_used ? alignment->rotation_error_rad : std::vector<double>();
  }
  *orientations = OrientationsInOneFrame(poses.groundtruth, poses.estimate);
  std::vector<double> errors_rad;
  if (orientations->kind == OrientationKind::kConstant) return errors_rad;
  for (std::size_t i = 0; i < poses.estimate.size(); ++i) {
    const Quaterniond expected = WithMount(poses.groundtruth[i], orientations->camera_from_body).rotation();
    errors_rad.push_back(AngleRad(expected.conjugate() * poses.estimate[i].rotation()));
  }
  return errors_rad;
}

}  // namespace

absl::Status AteOptions::Validate() const {
  if (!(max_dt_s >= 0.0) || max_dt_s > 1e6) {
    return absl::InvalidArgumentError(absl::StrCat("max_dt_s must be a number of seconds >= 0, is ", max_dt_s));
  }
  return absl::OkStatus();
}

absl::StatusOr<AteResult> EvaluateAte(std::span<const io::StampedPose> estimate,
                                      std::span<const io::StampedPose> groundtruth, const AteOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  const std::vector<io::StampedPose> est = SortedFinite(estimate);
  const std::vector<io::StampedPose> gt = SortedFinite(groundtruth);
  const std::vector<Association> pairs = AssociateNearest(est, gt, options.max_dt_s);
  if (pairs.size() < (options.align ? 3u : 1u)) {
    return absl::FailedPreconditionError(
        absl::StrCat("only ", pairs.size(), " of ", est.size(), " poses have ground truth within ", options.max_dt_s,
                     " s; check that both files use the same clock, or allow more (max_dt_s)"));
  }
  AteResult result;
  result.estimated = static_cast<int>(est.size());
  std::vector<Vector3d> true_points, estimated_points;
  for (const Association& pair : pairs) {
    true_points.push_back(gt[pair.groundtruth].world_from_camera.translation());
    estimated_points.push_back(est[pair.estimate].world_from_camera.translation());
  }
  if (options.align) {
    auto alignment = AlignPoints(true_points, estimated_points, {.with_scale = options.with_scale});
    if (!alignment.ok()) return Annotate(alignment.status(), "aligning the estimate to the ground truth");
    result.groundtruth_from_estimate = alignment->a_from_b;
    result.scale_sigma = alignment->scale_sigma;
  }

  const std::vector<double> rotation_errors_rad =
      RotationErrors(PosesOf(est, gt, pairs), options, &result.orientations);
  std::vector<double> errors_m;
  for (const Association& pair : pairs) {
    AtePose pose;
    pose.time_ns = est[pair.estimate].time_ns;
    pose.aligned = result.groundtruth_from_estimate.TransformPose(est[pair.estimate].world_from_camera);
    pose.groundtruth = gt[pair.groundtruth].world_from_camera;
    pose.error_m = (pose.groundtruth.translation() - pose.aligned.translation()).norm();
    if (!rotation_errors_rad.empty()) pose.rotation_error_rad = rotation_errors_rad[result.poses.size()];
    errors_m.push_back(pose.error_m);
    result.poses.push_back(pose);
  }
  result.position_m = Summarize(errors_m);
  result.rotation_rad = Summarize(rotation_errors_rad);
  result.path_length_m = PathLength(gt, est.front().time_ns, est.back().time_ns);
  return result;
}

}  // namespace cairn::eval
