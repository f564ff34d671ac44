// Which rows of a map differ between two of its revisions: what somebody who has the older one needs of the newer one.
// Rows are as in docs/map-format.md: what follows from others (observations of points, what is derived from them) has
// none of its own.
#pragma once

#include <optional>
#include <vector>

#include "map/snapshot.h"

namespace cairn::map {

struct ChangedKeyframe {
  KeyframeId id;
  bool features = false;  // the keyframe is new, or its keypoints have moved
  bool points = false;    // what its features observe is not what it was

  bool operator==(const ChangedKeyframe&) const = default;
};

// Ids that separate rows of two revisions: of each kind, all that the older one had are below, all that came later are
// not.
struct FirstNewIds {
  CameraId camera;
  SessionId session;
  ComponentId component;
  KeyframeId keyframe;
  PointId point;

  bool operator==(const FirstNewIds&) const = default;
};

// Ids of what was put or removed, ascending: what is in the newer revision was put. One that is not may never have been
// in the older one.
struct ChangedRows {
  Revision base = 0;   // of the older revision
  bool whole = false;  // there is none: these are all rows of the map
  bool info = false;
  std::vector<CameraId> cameras;
  std::vector<SessionId> sessions;
  std::vector<ComponentId> components;
  std::vector<ChangedKeyframe> keyframes;
  std::vector<PointId> points;

  std::optional<FirstNewIds> first_new;  // as far as a file remembers

  bool operator==(const ChangedRows&) const = default;
};

ChangedRows AllRows(const Snapshot& map);

// `before` and `after` are revisions of one map. At a cost in proportion to the change if `after` was made from
// `before` by Snapshot::Apply(), in any number of steps; O(map) if both were loaded by themselves.
ChangedRows RowsBetween(const Snapshot& before, const Snapshot& after);

}  // namespace cairn::map
