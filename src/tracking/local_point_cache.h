// The points of a set of keyframes, kept from one image of a stream to the next: what is around a camera changes
// slowly, and to look up some thousand points in a map takes as long as to match them.
#pragma once

#include <span>
#include <vector>

#include "map/snapshot.h"

namespace cairn::tracking {

// Of one map::Snapshot, which must live as long. For one thread at a time.
class LocalPointCache {
 public:
  // The points that `keyframes` observe, ascending by id, and perhaps those of some more that were asked for before.
  // Valid until the next call.
  std::span<const map::MapPoint* const> PointsOf(const map::Snapshot& map, std::span<const KeyframeId> keyframes);

 private:
  std::vector<KeyframeId> keyframes_;  // whose points are in points_; ascending
  std::vector<const map::MapPoint*> points_;
};

}  // namespace cairn::tracking
