// Points of which only the rows are known, as they are stored and sent: what follows from the keyframes that observe
// them is added, with the same result to the bit as where it was left out.
#pragma once

#include <memory>
#include <vector>

#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"

namespace cairn::map {

// `points` have their id, position, counts and reference.keyframe, and are all that are in `map` after the delta and
// whose observations, or the keyframes that observe them, it changes. They get the rest, and are put into `delta`,
// whose cameras, keyframes and removals are complete. `orb`: of the map. DataLoss naming a point whose observations do
// not hold.
absl::Status CompletePoints(const Snapshot& base, const image::OrbParameters& orb,
                            const std::vector<std::shared_ptr<MapPoint>>& points, Delta* delta);

}  // namespace cairn::map
