#include "mapping/feature_mapper_options.h"

#include "absl/strings/str_cat.h"
#include "base/status.h"

namespace cairn::mapping {

absl::Status FeatureMapperOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("feature mapper: ", what)); };
  if (min_features < 100 || max_features < min_features) return bad("features must satisfy 100 <= min <= max");
  if (!(slow_rate_hz > 0.0 && fast_rate_hz > slow_rate_hz)) return bad("rates must satisfy 0 < slow < fast");
  if (min_start_points < 20 || min_restart_points < 20) return bad("a start needs at least 20 points");
  CAIRN_RETURN_IF_ERROR(tracker.Validate());
  if (poor_inliers < tracker.min_inliers) return bad("poor_inliers must not be below the tracker's min_inliers");
  if (!(odometry_sigma_share >= 0.0) || !(odometry_sigma_depth > 0.0)) {
    return bad("odometry_sigma_share must not be negative and odometry_sigma_depth must be positive");
  }
  if (insert_below_matches < 0 || max_keyframes_between < 0) return bad("insertion limits must not be negative");
  if (!(max_seconds_between >= 0.0)) return bad("max_seconds_between must not be negative");
  if (!(insert_below_share >= 0.0 && insert_below_share <= 1.0)) return bad("insert_below_share must be in [0, 1]");
  if (triangulation_neighbours < 1) return bad("triangulation_neighbours must be at least 1");
  if (covered_points < 0) return bad("covered_points must not be negative");
  if (covered_age < 0) return bad("covered_age must not be negative");
  if (!(min_parallax_deg > 0.0)) return bad("min_parallax_deg must be positive");
  if (!(min_baseline_share >= 0.0)) return bad("min_baseline_share must not be negative");
  if (!(max_chi_square > 0.0)) return bad("max_chi_square must be positive");
  if (fusion_neighbours < 0 || fusion_second_neighbours < 0) return bad("fusion neighbours must not be negative");
  if (!(fusion_radius_px > 0.0)) return bad("fusion_radius_px must be positive");
  if (max_adjusted_keyframes < 1 || max_fixed_keyframes < 0) return bad("adjustment needs at least one keyframe");
  if (first_iterations < 1 || second_iterations < 0) return bad("iterations must be at least 1 and 0");
  if (max_final_keyframes < 0 || final_iterations < 1) return bad("the final adjustment needs at least one iteration");
  if (noise_iterations < 0) return bad("noise_iterations must not be negative");
  if (!(final_tolerance > 0.0)) return bad("final_tolerance must be positive");
  if (!(min_found_ratio >= 0.0 && min_found_ratio <= 1.0)) return bad("min_found_ratio must be in [0, 1]");
  if (judged_after < 1) return bad("judged_after must be at least 1");
  if (min_observations < 2 || young_keyframes < 1) return bad("points need at least 2 observations and 1 keyframe");
  for (const Redundancy& limit : {redundancy, redundancy_of_visits}) {
    if (!(limit.share > 0.0 && limit.share <= 1.0)) return bad("the share of a redundancy must be in (0, 1]");
    if (limit.observers < 1) return bad("the observers of a redundancy must be at least 1");
  }
  if (max_attempts < 1) return bad("max_attempts must be at least 1");
  return lens.Validate();
}

}  // namespace cairn::mapping
