#include "mapping/lens_refinement.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "absl/strings/str_format.h"
#include "map/lens.h"
#include "mapping/adjustment_problem.h"
#include "optimization/reprojection.h"

namespace cairn::mapping {
namespace {

// Observations that agree with the adjusted map.
std::vector<std::uint8_t> Inliers(const optimization::BundleProblem& problem) {
  std::vector<std::uint8_t> inliers;
  for (const optimization::BundleObservation& o : problem.observations) {
    const optimization::BundlePose& pose = problem.poses[o.pose];
    const Vector3d point_c = pose.camera_from_map * problem.points[o.point];
    const bool agrees =
        optimization::InFront(point_c) &&
        optimization::ReprojectionResidual(problem.cameras[pose.camera], point_c, o.pixel).squaredNorm() <=
            optimization::kChiSquarePixel95 * o.sigma_px * o.sigma_px;
    inliers.push_back(agrees ? 1 : 0);
  }
  return inliers;
}

// How far a lens is from the calibration, by the prior's standard deviations; of its parameters the farthest.
double PriorSigmas(const LensCorrection& lens) {
  const optimization::LensAdjustmentOptions prior;
  return std::max({std::abs(std::log(lens.focal_scale)) / prior.log_focal_sigma, std::abs(lens.k1) / prior.k1_sigma,
                   std::abs(lens.k2) / prior.k2_sigma});
}

}  // namespace

LensReport JudgeLens(const optimization::LensResult& result, const Pinhole& pinhole,
                     const LensRefinementOptions& options) {
  LensReport report;
  report.lens = result.lens;
  report.gain = result.gain;
  report.shift = result.lens.ShiftOver(pinhole);
  const double diagonal_px = std::hypot(pinhole.width_px, pinhole.height_px);
  const std::string found = absl::StrFormat("focal length x %.4f, k1 %.4f, k2 %.4f: %.2f px on average, up to %.2f px",
                                            result.lens.focal_scale, result.lens.k1, result.lens.k2,
                                            report.shift.rms_px, report.shift.max_px);
  if (!(report.shift.max_px <= options.max_shift_share * diagonal_px) ||
      !(PriorSigmas(result.lens) <= options.max_sigmas)) {
    report.another_camera = true;
    report.reason = absl::StrCat("not corrected: the images suggest another camera (", found, "); calibrate it");
  } else if (!(report.gain >= options.min_gain)) {
    report.reason = "as calibrated: the images say nothing else";
  } else {
    report.applied = true;
    report.reason = "corrected: " + found;
  }
  return report;
}

absl::Status LensRefinementOptions::Validate() const {
  if (!(min_gain > 0.0)) return absl::InvalidArgumentError("lens refinement: min_gain must be positive");
  if (!(max_sigmas > 0.0)) return absl::InvalidArgumentError("lens refinement: max_sigmas must be positive");
  if (!(max_shift_share > 0.0)) return absl::InvalidArgumentError("lens refinement: max_shift_share must be positive");
  return absl::OkStatus();
}

absl::StatusOr<std::optional<LensReport>> RefineLens(map::Edit& edit, std::span<const KeyframeId> keyframes,
                                                     CameraId camera, const LensRefinementOptions& options) {
  if (!options.enabled || edit.camera(camera).lens) return std::nullopt;
  LocalAdjustmentOptions all;
  all.max_fixed_keyframes = 0;
  const AdjustmentProblem built = BuildAdjustmentProblem(edit, keyframes, all);
  const auto index = std::find(built.cameras.begin(), built.cameras.end(), camera);
  if (index == built.cameras.end() || built.points.empty()) return std::nullopt;
  auto result = optimization::AdjustLens(built.problem, static_cast<std::uint32_t>(index - built.cameras.begin()),
                                         Inliers(built.problem));
  // Too few observations, or equations without an answer: the calibration stays.
  if (absl::IsFailedPrecondition(result.status()) || absl::IsInternal(result.status())) return std::nullopt;
  CAIRN_RETURN_IF_ERROR(result.status());
  const LensReport report = JudgeLens(*result, edit.pinhole(camera), options);
  if (!report.applied) return report;

  KeepScale(built, &result->camera_from_map, &result->points);
  map::MapCamera corrected = edit.camera(camera);
  corrected.lens = report.lens;
  edit.PutCamera(corrected);
  for (std::size_t i = 0; i < built.keyframes.size(); ++i) {
    if (built.problem.poses[i].fixed && i >= keyframes.size()) continue;
    edit.SetPose(built.keyframes[i], result->camera_from_map[i]);
  }
  for (std::size_t p = 0; p < built.points.size(); ++p) edit.SetPosition(built.points[p], result->points[p]);
  edit.base().keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    if (keyframe->camera != camera || edit.FindKeyframe(keyframe->id) == nullptr) return;
    std::vector<image::Keypoint> keypoints = keyframe->keypoints();
    map::CorrectKeypoints(corrected, keypoints);
    edit.SetKeypoints(keyframe->id, std::move(keypoints));
  });
  return report;
}

}  // namespace cairn::mapping
