// Closes a verified loop in an Edit: moves the neighbourhood of the current keyframe by the similarity, joins the
// points of both sides, and spreads the error over the essential graph (Mur-Artal, Montiel, Tardos, "ORB-SLAM", T-RO
// 2015, Sec. VII-C and D; Strasdat et al., RSS 2010).
#pragma once

#include <unordered_map>
#include <utility>
#include <vector>

#include "base/status.h"
#include "map/edit.h"
#include "mapping/loop_options.h"
#include "mapping/loop_verification.h"

namespace cairn::mapping {

// Pairs of keyframes that earlier loops have linked.
using LoopEdges = std::vector<std::pair<KeyframeId, KeyframeId>>;

// By how much lengths around a keyframe have grown.
using KeyframeScales = std::unordered_map<KeyframeId, double>;

struct LoopCorrection {
  KeyframeScales scales;  // of all keyframes that took part
  LoopEdges new_edges;
  int fused_points = 0;
  int added_observations = 0;
  int graph_keyframes = 0;
  int graph_edges = 0;
  double graph_initial_cost = 0.0;
  double graph_final_cost = 0.0;
};

// The loop keyframe stays where it is. On an error the edit is of no use.
absl::StatusOr<LoopCorrection> CorrectLoop(const Loop& loop, const LoopEdges& earlier, const LoopOptions& options,
                                           map::Edit& edit);

}  // namespace cairn::mapping
