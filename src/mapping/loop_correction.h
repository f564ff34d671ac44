// Closes a verified loop in an Edit: moves the neighbourhood of the current keyframe by the similarity, joins the
// points of both sides, and spreads the error over the essential graph (Mur-Artal, Montiel, Tardos, "ORB-SLAM", T-RO
// 2015, Sec. VII-C and D; Strasdat et al., RSS 2010).
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "base/status.h"
#include "map/edit.h"
#include "mapping/loop_options.h"
#include "mapping/loop_verification.h"
#include "mapping/map_head.h"

namespace cairn::mapping {

// Pairs of keyframes that earlier loops have linked.
using LoopEdges = std::vector<std::pair<KeyframeId, KeyframeId>>;

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

// Joins the points of both sides of a loop or of a seam between components: `matches` first, then those of `here` seen
// from `there` and the other way round. The two sides must lie in the same frame by now.
struct FusedSides {
  int points = 0;
  int observations = 0;
};
FusedSides FuseSides(const Loop& loop, std::span<const KeyframeId> here, std::span<const KeyframeId> there,
                     const LoopOptions& options, map::Edit& edit);

// Pairs of keyframes that the loops and joins which the map knows of have linked.
LoopEdges KnownLoopEdges(const map::Snapshot& map);

// The loop keyframe stays where it is, and so does what is held (mapping/held.h), unless the current keyframe's own
// surroundings are held: then the loop is one inside what is held. On an error the edit is of no use.
absl::StatusOr<LoopCorrection> CorrectLoop(const Loop& loop, const LoopEdges& earlier, const LoopOptions& options,
                                           map::Edit& edit);

}  // namespace cairn::mapping
