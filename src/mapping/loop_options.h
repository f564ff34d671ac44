// Settings of loop closing (Mur-Artal, Montiel, Tardos, "ORB-SLAM", T-RO 2015, Sec. VII), with defaults for every
// sequence. A loop that is missed can be found a few keyframes later; one that is wrong ruins the map.
#pragma once

#include <vector>

#include "base/status.h"

namespace cairn::mapping {

struct LoopOptions {
  // Detection: keyframes that look alike and are not linked to the current one.
  int min_keyframes_between = 10;  // inserted since the last loop
  int consistent_detections = 3;   // keyframes in a row that find the same place
  double min_common_share = 0.8;   // of the most words shared with any keyframe that is not linked
  double min_group_share = 0.75;   // of the score of the best group of covisible candidates

  // The similarity between the current keyframe and a candidate.
  int min_sim3_inliers = 20;    // of matches by descriptors, after RANSAC
  int min_guided_matches = 40;  // after matching by projection over the candidate's neighbourhood
  int min_cells = 10;           // of 8 x 8 in the image that hold them
  int neighbourhood = 15;       // covisible keyframes of the candidate whose points take part
  int match_max_distance = 60;  // Hamming, bits
  double match_max_ratio = 0.8;
  std::vector<double> guided_radius_factors = {4.0, 2.0};
  int guided_max_distance = 70;

  // Second check: the neighbours of the current keyframe must see the loop's points where the similarity puts them, and
  // the other way round; each finds the similarity anew from its own matches.
  int neighbours_checked = 6;           // per side, of those that should see enough of the other side's points
  int min_neighbours_agreeing = 2;      // per side (1 where nothing links the sides), and ...
  double min_agreeing_share = 0.6;      // ... of those checked
  int min_neighbour_visible = 40;       // points in view from which a neighbour is checked
  int min_neighbour_matches = 15;       // of these ...
  double min_neighbour_share = 0.1;     // ... and of the visible points
  double max_neighbour_turn_deg = 3.0;  // between the similarity and the neighbour's own
  double max_neighbour_scale = 1.15;    // ratio of their scales
  double max_neighbour_shift = 0.08;    // of the neighbour's camera, in median depths of the points it sees

  // Third check: odometry does not drift by any amount. Between the keyframe as it is and as the loop puts it, against
  // the length of the path between the two along the spanning tree.
  double max_drift_share = 0.25;  // of the path's length
  double drift_slack = 0.2;       // in median depths
  double max_turn_deg = 45.0;
  double max_scale_change = 3.0;

  // Where nothing links the two sides (a restart, another component), drift says nothing. More must be seen, more of
  // the image, and of the cells of the views in which each side should see points of the other, it must see some in
  // this share (mapping/view_share.h). In ten pairs of rendered rooms with furniture of one catalogue, wrong
  // similarities, of up to 134 matches, had at most 0.54 on the worse side; right ones had 0.73 and more in a real
  // kitchen, 0.87 in an office by other light and with another camera, and from 0.6 (through a doorway) to 0.95 in
  // rooms.
  int min_unlinked_matches = 50;
  int min_unlinked_cells = 12;
  double min_unlinked_share = 0.7;

  // Correction.
  double fusion_radius_px = 4.0;
  double fusion_extra_sigma_px = 1.5;  // of the similarity, seen in the neighbours
  double loop_edge_weight = 5.0;       // in the pose graph, where all others have 1 ...
  double restart_edge_weight = 0.05;   // ... but those across which nothing is shared
  int pose_graph_iterations = 30;

  absl::Status Validate() const;
};

}  // namespace cairn::mapping
