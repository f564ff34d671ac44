// Puts the rows of a map file together to what a map is made of: what rows leave out, because it follows from others,
// is added, and every reference is checked.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "base/status.h"
#include "map/delta.h"
#include "store/map_store.h"
#include "store/tables.h"

namespace cairn::store {

// Told of everything wrong. An error that it returns ends the reading; with OK the row at fault is left out.
using FindingSink = std::function<absl::Status(const Finding&)>;

// All tables of a map file but the vocabulary and the log of changes.
struct MapRows {
  std::int64_t format = 0;
  MapRow map_row;
  map::Delta content;  // cameras, sessions and components, ascending
  // Ascending, with features and the points they observe; without neighbours and children.
  std::vector<std::shared_ptr<map::Keyframe>> keyframes;
  std::vector<PointRow> points;  // ascending
  std::vector<EdgeRow> edges;

  map::Keyframe* FindKeyframe(std::int64_t id);  // null: none
};

// The neighbours of a keyframe in their order.
void SortCovisible(map::Keyframe* keyframe);

// All of the map as the one change that leads from nothing to its revision.
absl::StatusOr<map::Delta> AssembleMap(MapRows rows, const FindingSink& sink);

}  // namespace cairn::store
