// The settings of tracking::Relocalizer, with defaults for every map and camera.
#pragma once

#include <vector>

#include "base/status.h"
#include "tracking/group_matcher.h"
#include "tracking/local_map.h"
#include "tracking/pnp_ransac.h"

namespace cairn::tracking {

struct RelocalizerOptions {
  // Features and candidates.
  int min_features = 30;
  int max_candidate_keyframes = 40;  // that share words, best score first
  int max_groups = 6;                // covisibility groups that are matched
  int max_poses = 4;             // of these, for how many a pose is looked for: the first, and those with most matches
  int group_size = 8;            // keyframes of a group: the candidate and its best covisible ones
  double min_group_score = 0.5;  // share of the best group's score below which groups are not tried

  // Matches and PnP.
  GroupMatchOptions matching;
  int min_word_matches = 15;
  PnpOptions pnp;  // its seed is mixed with the group's number

  // Guided search: one round per factor.
  std::vector<double> guided_radius_factors = {4.0, 2.0, 1.5};
  int guided_max_distance = 75;  // Hamming, bits
  double guided_max_ratio = 0.9;
  double guided_max_viewing_angle_deg = 75.0;
  double guided_distance_slack = 1.5;
  int descriptors_per_point = 5;  // of its observations, compared with each feature near its projection
  LocalMapOptions local_map{.max_keyframes = 20, .neighbours_per_keyframe = 5, .tree_neighbours = true};

  // Acceptance. Inliers alone prove little: an object that has a twin elsewhere, furniture that stands in two rooms,
  // give more than a hundred in a part of the image. They must be nearly everywhere where points should be in view: of
  // the cells that should show at least three, a share less two of its standard deviations, as few cells say little. In
  // nine pairs of rendered rooms with furniture of one catalogue 97 % of the images of the wrong room came to 0.33 or
  // less, 97 % of a real kitchen's and of rendered rooms' to 0.35 and more.
  int min_inliers = 25;
  int min_cells = 8;  // of 8 x 8 in the image that must hold inliers
  double min_support = 0.35;
  // Beyond doubt. Below it the other groups are tried, too; and a session does not go on there without further proof.
  int strong_inliers = 50;
  double strong_support = 0.45;

  // Rivals: other places of the map that look like it. So many groups are matched, and the two with most matches tried.
  // An answer is one only if neither is accepted with so large a share of its inliers; else it is ambiguous. In
  // rendered corridors with two sides that are exactly alike the right side had at least 0.46 of the wrong one's where
  // it had fewer; in rooms with the same furniture none was accepted. 0: nobody asks.
  int max_rivals = 6;
  double max_rival_share = 0.33;
  double max_position_sigma = 0.02;  // standard deviation of the position, as share of the median depth of the inliers
  double max_rotation_sigma_deg = 0.6;

  // For who proves an answer in ways of his own.
  static RelocalizerOptions WithoutRivals() {
    RelocalizerOptions options;
    options.max_rivals = 0;
    return options;
  }

  absl::Status Validate() const;
};

}  // namespace cairn::tracking
