// How far keyframes are from each other along the graph of a map, which is what odometry can have drifted over: two
// views from the same place may be neighbours in space and far apart in the graph.
#pragma once

#include <unordered_map>

#include "map/snapshot.h"

namespace cairn::tracking {

// Keyframes that are at most `max_length` away from `from`, with the length of the shortest way there, map units: from
// camera to camera over covisibility links and over those of the spanning tree within one segment of the odometry.
// Empty if the map does not have `from`.
std::unordered_map<KeyframeId, double> KeyframesWithin(const map::Snapshot& map, KeyframeId from, double max_length);

}  // namespace cairn::tracking
