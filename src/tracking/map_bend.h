// How far the map is bent around a keyframe. The poses of its keyframes were found twice: by the direct odometry, from
// the light of all pixels, and by bundle adjustment, from features. Where lens, shutter or haste fool one of them, the
// two bend differently; what no similarity takes away is what the map may be off there, and no image that fits the map
// well can show that.
//
// It counts only what differs around the keyframe: odometry drifts, the map does not where it closed a loop, so
// keyframes of before and after a loop are not compared. What both err alike (the focal length) is not in it.
#pragma once

#include "base/ids.h"
#include "map/snapshot.h"
#include "tracking/map_error.h"

namespace cairn::tracking {

// Standard deviations per axis over the keyframes that see most of the same points, as far as they are of one stretch
// of the odometry; zero where fewer than four are, or poses were given.
MapError BendAround(const map::Snapshot& map, KeyframeId keyframe);

// Of two measures of what the map errs, how badly the image fits and how far the map is bent there, the larger of each.
MapError Larger(const MapError& a, const MapError& b);

}  // namespace cairn::tracking
