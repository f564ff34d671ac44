#include "mapping/loop_options.h"

#include <algorithm>

namespace cairn::mapping {

absl::Status LoopOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("loop closing: ", what)); };
  const auto share = [](double x) { return x >= 0.0 && x <= 1.0; };
  if (min_keyframes_between < 0) return bad("min_keyframes_between must not be negative");
  if (consistent_detections < 1) return bad("consistent_detections must be at least 1");
  if (!share(min_common_share) || !share(min_group_share)) return bad("shares of words and scores must be in [0, 1]");
  if (min_sim3_inliers < 10) return bad("min_sim3_inliers must be at least 10");
  if (min_guided_matches < min_sim3_inliers) return bad("min_guided_matches must be at least min_sim3_inliers");
  if (min_cells < 1 || min_cells > 64) return bad("min_cells must be 1 to 64");
  if (neighbourhood < 1) return bad("neighbourhood must be at least 1");
  if (match_max_distance < 0 || match_max_distance > 256 || guided_max_distance < 0 || guided_max_distance > 256) {
    return bad("Hamming distances must be 0 to 256 bits");
  }
  if (!(match_max_ratio > 0.0 && match_max_ratio <= 1.0)) return bad("match_max_ratio must be in (0, 1]");
  if (guided_radius_factors.empty() || !(*std::ranges::min_element(guided_radius_factors) > 0.0)) {
    return bad("guided_radius_factors must be one or more positive numbers");
  }
  if (neighbours_checked < min_neighbours_agreeing || min_neighbours_agreeing < 1) {
    return bad("neighbours_checked must be at least min_neighbours_agreeing, and that at least 1");
  }
  if (!share(min_agreeing_share) || !share(min_neighbour_share)) return bad("shares of neighbours must be in [0, 1]");
  if (min_neighbour_matches < 10 || min_neighbour_visible < min_neighbour_matches) {
    return bad("min_neighbour_matches must be at least 10, min_neighbour_visible no less");
  }
  if (!(max_neighbour_turn_deg > 0.0) || !(max_neighbour_scale > 1.0) || !(max_neighbour_shift > 0.0)) {
    return bad("what neighbours may differ by must be positive (the scale above 1)");
  }
  if (!(max_drift_share > 0.0) || !(drift_slack >= 0.0) || !(max_turn_deg > 0.0) || !(max_scale_change > 1.0)) {
    return bad("limits of drift must be positive (the scale above 1)");
  }
  if (min_unlinked_matches < min_guided_matches || min_unlinked_cells < min_cells || min_unlinked_cells > 64) {
    return bad("what is needed where nothing links the sides must not be less than elsewhere");
  }
  if (!share(min_unlinked_share)) return bad("min_unlinked_share must be in [0, 1]");
  if (!(restart_edge_weight > 0.0)) return bad("restart_edge_weight must be positive");
  if (!(fusion_radius_px > 0.0) || !(fusion_extra_sigma_px >= 0.0)) return bad("fusion_radius_px must be positive");
  if (!(loop_edge_weight > 0.0)) return bad("loop_edge_weight must be positive");
  if (pose_graph_iterations < 1) return bad("pose_graph_iterations must be at least 1");
  return absl::OkStatus();
}

}  // namespace cairn::mapping
