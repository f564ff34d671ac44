// The parts of a map that nothing links. After a loss that nothing bridged, mapping goes on beside what it had: each
// part is right in itself, but where it lies in the map frame, and how large it is there, is a guess until a loop joins
// it.
#pragma once

#include <unordered_map>
#include <vector>

#include "map/snapshot.h"

namespace cairn::map {

// Keyframes are linked by shared points (kMinCovisiblePoints), by closed loops, by the odometry within one of its
// segments, and by given poses, which share a frame.
class LinkedParts {
 public:
  // O(map).
  explicit LinkedParts(const Snapshot& map);

  // Keyframes of each part, ascending; the part with most keyframes first, then the one with the older keyframe. One
  // for most maps, none for an empty one.
  const std::vector<std::vector<KeyframeId>>& parts() const { return parts_; }
  // Which of them a keyframe is in; -1 if the map does not have it.
  int PartOf(KeyframeId keyframe) const;

 private:
  std::vector<std::vector<KeyframeId>> parts_;
  std::unordered_map<KeyframeId, int> part_of_;
};

}  // namespace cairn::map
