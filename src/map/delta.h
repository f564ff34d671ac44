// The only way a map changes. The same Delta is applied to the Snapshot in memory, committed to the file as one
// transaction, streamed to followers and drawn by viewers.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "map/entities.h"

namespace cairn::map {

struct Delta {
  Revision base = 0;         // the revision that this changes ...
  Revision num_changes = 1;  // ... by so many: 1 as it is made, more once merged with those that followed
  std::string reason;        // for people: "insert keyframe 12", "local bundle adjustment"
  SessionId session;         // that made it; none: somebody else edited the map

  std::optional<MapInfo> info;        // replaces the map's
  std::vector<MapCamera> cameras;     // added or replaced, ascending by id, like all that follow
  std::vector<Session> sessions;      // likewise; they are never removed, only marked so
  std::vector<Component> components;  // likewise
  std::vector<CameraId> removed_cameras;
  std::vector<ComponentId> removed_components;             // without keyframes, and not history
  std::vector<std::shared_ptr<const Keyframe>> keyframes;  // added or replaced
  // Of those replaced: whose keypoints have moved too (a camera's lens was corrected). All else of a keyframe's
  // features never changes.
  std::vector<KeyframeId> moved_keypoints;
  std::vector<KeyframeId> removed_keyframes;
  std::vector<std::shared_ptr<const MapPoint>> points;  // added or replaced
  std::vector<PointId> removed_points;
  // The next free ids after this change; ids are never used twice.
  KeyframeId next_keyframe{1};
  PointId next_point{1};
  CameraId next_camera{1};
  SessionId next_session{1};
  ComponentId next_component{1};

  Revision revision() const { return base + num_changes; }
  bool empty() const {
    return !info && cameras.empty() && sessions.empty() && components.empty() && removed_cameras.empty() &&
           removed_components.empty() && keyframes.empty() && removed_keyframes.empty() && points.empty() &&
           removed_points.empty();
  }
};

class Snapshot;

// `first`, which starts from `base`, and `second`, which starts from the map after `first`, as one change of `base`.
// InvalidArgument if the second does not follow the first. O(both); for those who fell behind.
absl::StatusOr<Delta> MergeDeltas(const Snapshot& base, const Delta& first, const Delta& second);

}  // namespace cairn::map
