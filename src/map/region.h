// A part of a map: what a camera at some place may come to see. For followers that have no room for all of it.
#pragma once

#include <vector>

#include "map/changed_rows.h"
#include "map/snapshot.h"

namespace cairn::map {

// Around keyframes, or around a place in a component: the keyframes that are connected with them by shared points, the
// nearest in steps first, and of these those with most points in common.
struct RegionQuery {
  std::vector<KeyframeId> around;  // if there are none, of those in `component` the one nearest to `center`
  ComponentId component;
  Vector3d center = Vector3d::Zero();  // in the frame of the component
  int max_keyframes = 1000;
  bool operator==(const RegionQuery&) const = default;
};

// Ascending; none if there is nothing there.
std::vector<KeyframeId> KeyframesAround(const Snapshot& map, const RegionQuery& query);

// A region is a map by itself: its keyframes, the points that they observe, with links among them alone. The rows that
// lead somebody who has the region `had` of an older revision to the region `has` of `after`; `changed`: between the
// two revisions, of all of the map. Both ascending.
ChangedRows RowsOfRegion(const std::vector<KeyframeId>& had, const ChangedRows& changed, const Snapshot& after,
                         const std::vector<KeyframeId>& has);

// Everything in `map`, as a change of an empty one.
Delta AllOf(const Snapshot& map);

}  // namespace cairn::map
