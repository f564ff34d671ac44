// What makes a change of a map a good one. Nothing else checks deltas: the store and everyone who follows a map rely on
// Snapshot::Apply(), which calls these two.
#pragma once

#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"

namespace cairn::map {

// The delta by itself and against the map that it changes: ids in order and given out, what is removed is there and is
// not put as well, values finite and in range, features as they were. InvalidArgument naming what is wrong.
absl::Status CheckDelta(const Snapshot& before, const Delta& delta);

// The map after it, around everything that the delta put or removed: every reference resolves both ways, also those to
// what is gone; links stay within a component; a component that was joined is empty. InvalidArgument likewise.
// O(delta), but O(map) for the removal of a camera.
absl::Status CheckChanged(const Snapshot& before, const Snapshot& after, const Delta& delta);

// Every reference of a keyframe or point in `map`. DataLoss naming the first that does not hold.
absl::Status CheckKeyframe(const Snapshot& map, const Keyframe& keyframe);
absl::Status CheckPoint(const Snapshot& map, const MapPoint& point);
// All cameras, sessions and components.
absl::Status CheckHeads(const Snapshot& map);

}  // namespace cairn::map
