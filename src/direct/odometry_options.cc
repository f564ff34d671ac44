#include "direct/odometry_options.h"

#include "absl/strings/str_cat.h"
#include "direct/image_pyramid.h"
#include "direct/keyframe.h"

namespace cairn::direct {
namespace {

absl::Status Check(bool good, absl::string_view name, double value, absl::string_view wanted) {
  if (good) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("odometry option ", name, " is ", value, ", must be ", wanted));
}

}  // namespace

absl::Status OdometryOptions::Validate() const {
  const struct {
    bool good;
    const char* name;
    double value;
    const char* wanted;
  } checks[] = {
      {max_pyramid_levels >= 1 && max_pyramid_levels <= kMaxLevels, "max_pyramid_levels", 1.0 * max_pyramid_levels,
       "1 to 8"},
      {min_level_pixels >= 64, "min_level_pixels", 1.0 * min_level_pixels, "at least 64"},
      {max_keyframes >= 3 && max_keyframes < kMaxWindow, "max_keyframes", 1.0 * max_keyframes, "3 to 11"},
      {min_keyframes >= 2 && min_keyframes <= max_keyframes, "min_keyframes", 1.0 * min_keyframes,
       "2 to max_keyframes"},
      {max_active_points >= 100, "max_active_points", 1.0 * max_active_points, "at least 100"},
      {candidates_per_keyframe >= 100, "candidates_per_keyframe", 1.0 * candidates_per_keyframe, "at least 100"},
      {max_iterations >= 1, "max_iterations", 1.0 * max_iterations, "at least 1"},
      {huber_gray > 0.0, "huber_gray", huber_gray, "positive"},
      {gradient_constant_gray > 0.0, "gradient_constant_gray", gradient_constant_gray, "positive"},
      {outlier_gray > 0.0, "outlier_gray", outlier_gray, "positive"},
      {outlier_median_factor > 1.0, "outlier_median_factor", outlier_median_factor, "above 1"},
      {affine_a_sigma >= 0.0, "affine_a_sigma", affine_a_sigma, "0 or positive"},
      {affine_b_sigma_gray >= 0.0, "affine_b_sigma_gray", affine_b_sigma_gray, "0 or positive"},
      {gradient_offset_gray >= 0.0, "gradient_offset_gray", gradient_offset_gray, "0 or positive"},
      {max_search_share > 0.0 && max_search_share < 0.5, "max_search_share", max_search_share, "in (0, 0.5)"},
      {trace_slack_px > 0.0, "trace_slack_px", trace_slack_px, "positive"},
      {min_trace_quality >= 1.0, "min_trace_quality", min_trace_quality, "at least 1"},
      {keyframe_weight > 0.0, "keyframe_weight", keyframe_weight, "positive"},
      {keyframe_min_tracked_share >= 0.0 && keyframe_min_tracked_share < 1.0, "keyframe_min_tracked_share",
       keyframe_min_tracked_share, "in [0, 1)"},
      {motion_sigma_factor > 0.0, "motion_sigma_factor", motion_sigma_factor, "positive"},
      {min_visible_share >= 0.0 && min_visible_share < 1.0, "min_visible_share", min_visible_share, "in [0, 1)"},
      {coarse_cutoff_gray > huber_gray, "coarse_cutoff_gray", coarse_cutoff_gray, "above huber_gray"},
      {min_tracked_share > 0.0 && min_tracked_share < 1.0, "min_tracked_share", min_tracked_share, "in (0, 1)"},
      {max_lost_frames >= 1, "max_lost_frames", 1.0 * max_lost_frames, "at least 1"},
      {start_features >= 2 * start_min_features, "start_features", 1.0 * start_features,
       "twice start_min_features or more"},
      {start_min_features >= 20, "start_min_features", 1.0 * start_min_features, "at least 20"},
      {start_min_parallax_deg > 0.0, "start_min_parallax_deg", start_min_parallax_deg, "positive"},
      {start_max_reprojection_px > 0.0, "start_max_reprojection_px", start_max_reprojection_px, "positive"},
      {start_min_inlier_share > 0.0 && start_min_inlier_share <= 1.0, "start_min_inlier_share", start_min_inlier_share,
       "in (0, 1]"},
      {max_retained_frames >= 10, "max_retained_frames", 1.0 * max_retained_frames, "at least 10"},
  };
  for (const auto& check : checks) {
    const absl::Status status = Check(check.good, check.name, check.value, check.wanted);
    if (!status.ok()) return status;
  }
  return absl::OkStatus();
}

OdometryOptions PresetOptions(Preset preset) {
  OdometryOptions options;
  switch (preset) {
    case Preset::kFast:
      options.max_keyframes = 5;
      options.max_active_points = 500;
      options.candidates_per_keyframe = 500;
      options.max_iterations = 3;
      break;
    case Preset::kDefault:
      break;
    case Preset::kAccurate:
      options.max_active_points = 1200;
      options.candidates_per_keyframe = 1200;
      options.max_iterations = 8;
      break;
  }
  return options;
}

absl::StatusOr<Preset> PresetFromName(absl::string_view name) {
  if (name == "fast") return Preset::kFast;
  if (name == "default") return Preset::kDefault;
  if (name == "accurate") return Preset::kAccurate;
  return absl::InvalidArgumentError(absl::StrCat("unknown preset \"", name, "\": use fast, default or accurate"));
}

}  // namespace cairn::direct
