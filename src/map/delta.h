// The only way a map changes. The same Delta is applied to the Snapshot in memory, committed to the file as one
// transaction, streamed to followers and drawn by viewers.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "map/entities.h"

namespace cairn::map {

struct Delta {
  Revision base = 0;   // the revision that this changes; the result is base + 1
  std::string reason;  // for people: "insert keyframe 12", "local bundle adjustment"

  std::optional<MapInfo> info;                             // replaces the map's
  std::vector<MapCamera> cameras;                          // added or replaced
  std::vector<Session> sessions;                           // added or replaced
  std::vector<std::shared_ptr<const Keyframe>> keyframes;  // added or replaced, ascending by id
  // Of those replaced: whose keypoints have moved too (a camera's lens was corrected). All else of a keyframe's
  // features never changes.
  std::vector<KeyframeId> moved_keypoints;
  std::vector<KeyframeId> removed_keyframes;
  std::vector<std::shared_ptr<const MapPoint>> points;  // added or replaced, ascending by id
  std::vector<PointId> removed_points;
  // The next free ids after this change; ids are never used twice.
  KeyframeId next_keyframe{1};
  PointId next_point{1};

  Revision revision() const { return base + 1; }
  bool empty() const {
    return !info && cameras.empty() && sessions.empty() && keyframes.empty() && removed_keyframes.empty() &&
           points.empty() && removed_points.empty();
  }
};

}  // namespace cairn::map
