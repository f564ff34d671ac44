// What two maps with a common past differ in: a map and an earlier copy of it, or two that went on from one copy. In
// one map ids are never used twice; in two that went on, or have nothing in common, the same ids stand for other
// things.
//
// Where a component is placed does not matter: each is laid onto the other map's by the similarity that fits the
// cameras of its common keyframes best, robustly, so that what has moved stands out.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"

namespace cairn::inspect {

// The keyframe of `other` that this is as well; none: null. Apart from its id and time a keyframe has the pose that it
// came with, which nothing changes and two runs of one recording hardly share.
const map::Keyframe* SameKeyframe(const map::Keyframe& keyframe, const map::Snapshot& other);
// The same but for the id, which merging changes.
bool SameButForId(const map::Keyframe& a, const map::Keyframe& b);

struct DifferenceOptions {
  bool align = true;  // false: positions are compared as they stand
};

struct KeyframeMove {
  KeyframeId id;
  double shift = 0.0;  // of the camera, in the unit of Placed() in the first map (measures.h)
  double turn_deg = 0.0;
};

struct PointMove {
  PointId id;
  double shift = 0.0;
};

struct ComponentFit {
  ComponentId first, second;   // of the one map and of the other
  std::int64_t keyframes = 0;  // common
  bool aligned = false;        // by a similarity; false: too few, on a line, or not asked for
  Sim3 first_from_second;      // frames of the components
  bool metres = false;         // the component of the first map is aligned to the world: shifts are metres
};

// Ids ascending; moves by their shift, the largest first.
struct MapDifference {
  std::vector<KeyframeId> keyframes_added, keyframes_removed;
  std::vector<PointId> points_added, points_removed;
  std::vector<SessionId> sessions_added;
  std::vector<SessionId> sessions_removed;                     // gone, or marked as removed
  std::vector<ComponentId> components_added, components_gone;  // gone: removed, or joined to another
  std::vector<ComponentId> realigned;                          // whose place in the world is another
  std::vector<CameraId> cameras_added, cameras_removed;
  std::vector<CameraId> cameras_changed;  // of the same calibration, of which the map corrected the lens meanwhile
  bool anchor_changed = false;            // where the world is on the earth (MapInfo::geo_anchor)
  std::vector<ComponentFit> fits;
  std::vector<KeyframeMove> keyframe_moves;  // of all common keyframes
  std::vector<PointMove> point_moves;        // of all common points
  std::int64_t keyframes_kept = 0, points_kept = 0;
  std::int64_t observations_before = 0, observations_after = 0;  // of everything

  bool same() const;  // nothing is added, removed, moved or placed elsewhere
};

// FailedPrecondition if the two have no keyframe in common although both have some.
absl::StatusOr<MapDifference> Compare(const map::Snapshot& first, const map::Snapshot& second,
                                      const DifferenceOptions& options = {});

}  // namespace cairn::inspect
