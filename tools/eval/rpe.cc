#include "eval/rpe.h"

#include <cmath>

#include "eval/ate.h"
#include "eval/reference.h"
#include "geometry/pose_alignment.h"
#include "geometry/pose_association.h"

namespace cairn::eval {

absl::Status RpeOptions::Validate() const {
  if (deltas.empty()) return absl::InvalidArgumentError("deltas must name at least one segment length");
  for (const double delta : deltas) {
    if (!(delta > 0.0) || !std::isfinite(delta)) {
      return absl::InvalidArgumentError(absl::StrCat("a segment length must be positive, is ", delta));
    }
  }
  return AteOptions{.max_dt_s = max_dt_s}.Validate();
}

namespace {

struct Pair {
  double time_s = 0.0;
  double path_m = 0.0;  // along the ground truth
  SE3 estimate;         // scaled
  SE3 groundtruth;      // in the frame of its positions
  Quaterniond turned;   // the reference's orientation of the camera, in whatever frame that is
};

// The associated poses with the length of the true path up to each, over all ground-truth samples in between.
std::vector<Pair> MakePairs(std::span<const io::StampedPose> est, std::span<const io::StampedPose> gt,
                            std::span<const Association> associations, double scale) {
  std::vector<double> path_m(gt.size(), 0.0);
  for (std::size_t i = 1; i < gt.size(); ++i) {
    path_m[i] =
        path_m[i - 1] + (gt[i].world_from_camera.translation() - gt[i - 1].world_from_camera.translation()).norm();
  }
  std::vector<Pair> pairs;
  for (const Association& a : associations) {
    const SE3& pose = est[a.estimate].world_from_camera;
    pairs.push_back({ToSeconds(est[a.estimate].time_ns - est.front().time_ns), path_m[a.groundtruth],
                     SE3(pose.rotation(), scale * pose.translation()), gt[a.groundtruth].world_from_camera,
                     gt[a.groundtruth].world_from_camera.rotation()});
  }
  return pairs;
}

// Gives the ground truth orientations of the camera, those of the estimate where its own are not in the frame of its
// positions. False if it has none that tell of turns.
bool MakeComparable(std::vector<Pair>& pairs, const PairedPoses& poses, OrientationAgreement* orientations) {
  const auto alignment = AlignPoses(poses.groundtruth, poses.estimate);
  if (!alignment.ok()) {
    *orientations = CompareOrientations(poses.groundtruth, poses.estimate);
    return true;
  }
  *orientations = alignment->orientations;
  for (Pair& pair : pairs) {
    const SE3 of_camera = WithMount(pair.groundtruth, orientations->camera_from_body);
    pair.turned = of_camera.rotation();
    pair.groundtruth = alignment->orientations_used ? of_camera
                                                    : SE3(alignment->a_from_b.rotation() * pair.estimate.rotation(),
                                                          pair.groundtruth.translation());
  }
  // A camera that hardly turns agrees with orientations that mean nothing.
  return alignment->orientations_used || (orientations->kind == OrientationKind::kOtherFrame && orientations->turns);
}

double Span(const Pair& from, const Pair& to, std::size_t frames, RpeUnit unit) {
  switch (unit) {
    case RpeUnit::kFrames:
      return static_cast<double>(frames);
    case RpeUnit::kMeters:
      return to.path_m - from.path_m;
    case RpeUnit::kSeconds:
      return to.time_s - from.time_s;
  }
  return 0.0;
}

RpeResult EvaluateDelta(std::span<const Pair> pairs, double delta, RpeUnit unit) {
  RpeResult result;
  result.delta = delta;
  std::vector<double> translation_m, rotation_rad;
  double error_sum_m = 0.0, length_sum_m = 0.0;
  // Written times are rounded, so a segment of exactly delta must not be missed by a rounding error.
  const double reach = delta * (1.0 - 1e-6) - (unit == RpeUnit::kSeconds ? 1e-5 : 0.0);
  std::size_t j = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    j = std::max(j, i + 1);
    while (j < pairs.size() && Span(pairs[i], pairs[j], j - i, unit) < reach) ++j;
    if (j >= pairs.size()) break;
    const SE3 true_motion = pairs[i].groundtruth.Inverse() * pairs[j].groundtruth;
    const SE3 motion = pairs[i].estimate.Inverse() * pairs[j].estimate;
    const SE3 error = true_motion.Inverse() * motion;
    translation_m.push_back(error.translation().norm());
    const Quaterniond turn = pairs[i].turned.conjugate() * pairs[j].turned;
    rotation_rad.push_back(AngleRad(turn.conjugate() * motion.rotation()));
    error_sum_m += translation_m.back();
    length_sum_m += pairs[j].path_m - pairs[i].path_m;
  }
  result.segments = static_cast<int>(translation_m.size());
  result.translation_m = Summarize(translation_m);
  result.rotation_rad = Summarize(rotation_rad);
  if (length_sum_m > 0.0) result.drift_percent = 100.0 * error_sum_m / length_sum_m;
  return result;
}

}  // namespace

absl::StatusOr<RpeResults> EvaluateRpe(std::span<const io::StampedPose> estimate,
                                       std::span<const io::StampedPose> groundtruth, const RpeOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  double scale = 1.0;
  if (options.with_scale) {
    CAIRN_ASSIGN_OR_RETURN(const AteResult ate, EvaluateAte(estimate, groundtruth, {.max_dt_s = options.max_dt_s}));
    scale = ate.groundtruth_from_estimate.scale();
  }
  const std::vector<io::StampedPose> est = SortedFinite(estimate);
  const std::vector<io::StampedPose> gt = SortedFinite(groundtruth);
  const std::vector<Association> associations = AssociateNearest(est, gt, options.max_dt_s);
  if (associations.size() < 2) {
    return absl::FailedPreconditionError(absl::StrCat("only ", associations.size(), " of ", est.size(),
                                                      " poses have ground truth within ", options.max_dt_s, " s"));
  }
  std::vector<Pair> pairs = MakePairs(est, gt, associations, scale);
  RpeResults results;
  const bool rotations = MakeComparable(pairs, PosesOf(est, gt, associations), &results.orientations);
  for (const double delta : options.deltas) {
    results.per_delta.push_back(EvaluateDelta(pairs, delta, options.unit));
    if (!rotations) results.per_delta.back().rotation_rad = Statistics();
  }
  return results;
}

}  // namespace cairn::eval
