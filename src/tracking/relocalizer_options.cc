#include "tracking/relocalizer_options.h"

#include "tracking/projection_matcher.h"
#include "tracking/view_support.h"

namespace cairn::tracking {

absl::Status RelocalizerOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("relocalizer: ", what)); };
  if (min_features < 4) return bad("min_features must be at least 4");
  if (max_candidate_keyframes < 1) return bad("max_candidate_keyframes must be at least 1");
  if (max_groups < 1) return bad("max_groups must be at least 1");
  if (max_poses < 1) return bad("max_poses must be at least 1");
  if (group_size < 1) return bad("group_size must be at least 1");
  if (!(min_group_score >= 0.0 && min_group_score <= 1.0)) return bad("min_group_score must be in [0, 1]");
  if (min_word_matches < 4) return bad("min_word_matches must be at least 4");
  if (guided_radius_factors.empty()) return bad("guided_radius_factors must have at least one entry");
  for (const double factor : guided_radius_factors) {
    if (!(factor > 0.0)) return bad("guided_radius_factors must be positive");
  }
  if (descriptors_per_point < 1) return bad("descriptors_per_point must be at least 1");
  if (min_inliers < 6) return bad("min_inliers must be at least 6");
  if (min_cells < 1 || min_cells > ViewSupport::kCellsPerSide * ViewSupport::kCellsPerSide)
    return bad("min_cells must be from 1 to 64");
  if (!(min_support >= 0.0 && min_support <= 1.0)) return bad("min_support must be in [0, 1]");
  if (strong_inliers < min_inliers) return bad("strong_inliers must not be below min_inliers");
  if (!(strong_support >= min_support && strong_support <= 1.0)) {
    return bad("strong_support must be in [min_support, 1]");
  }
  if (max_rivals < 0) return bad("max_rivals must not be negative");
  if (!(max_rival_share > 0.0 && max_rival_share <= 1.0)) return bad("max_rival_share must be in (0, 1]");
  if (!(max_position_sigma > 0.0)) return bad("max_position_sigma must be positive");
  if (!(max_rotation_sigma_deg > 0.0)) return bad("max_rotation_sigma_deg must be positive");
  ProjectionOptions projection;
  projection.max_distance = guided_max_distance;
  projection.max_ratio = guided_max_ratio;
  projection.max_viewing_angle_deg = guided_max_viewing_angle_deg;
  projection.distance_slack = guided_distance_slack;
  CAIRN_RETURN_IF_ERROR(Annotate(projection.Validate(), "relocalizer: guided search"));
  CAIRN_RETURN_IF_ERROR(matching.Validate());
  CAIRN_RETURN_IF_ERROR(local_map.Validate());
  return pnp.Validate();
}

}  // namespace cairn::tracking
