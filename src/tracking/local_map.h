// The part of a map around a camera: keyframes that see what it sees, their neighbours, and all their points
// (Mur-Artal, Montiel, Tardos, "ORB-SLAM", T-RO 2015, Sec. V-D; the local keyframes of Sec. V-C of "Loosely-Coupled
// Semi-Direct Monocular SLAM"). Works on a Snapshot and on an Edit alike.
#pragma once

#include <span>
#include <vector>

#include "base/status.h"
#include "map/edit.h"
#include "map/snapshot.h"
#include "tracking/projection_matcher.h"

namespace cairn::tracking {

struct LocalMapOptions {
  int max_keyframes = 80;
  int neighbours_per_keyframe = 10;  // best covisible keyframes of each keyframe that shares points
  bool tree_neighbours = true;       // parent and children of each as well

  absl::Status Validate() const;
};

struct LocalMap {
  // Keyframes that see the given points, most first, and then their neighbours. Of equal ones the smaller id comes
  // first.
  std::vector<KeyframeId> keyframes;
  std::size_t num_sharing = 0;  // the first so many keyframes see given points themselves
  // The points of these keyframes, ascending by id. They live as long as the map they come from is not changed.
  std::vector<const map::MapPoint*> points;

  KeyframeId reference() const { return keyframes.empty() ? KeyframeId() : keyframes.front(); }
};

// `MapView` is map::Snapshot or map::Edit. Points and keyframes that do not exist (any more) are passed over.
template <class MapView>
LocalMap LocalMapOfPoints(const MapView& map, std::span<const PointId> seen, const LocalMapOptions& options = {});

// LocalMap::keyframes of LocalMapOfPoints(), for who needs no points.
template <class MapView>
std::vector<KeyframeId> LocalKeyframesOfPoints(const MapView& map, std::span<const PointId> seen,
                                               const LocalMapOptions& options = {});

// Around given keyframes, which come first in the order given; and the keyframes alone.
template <class MapView>
std::vector<KeyframeId> LocalKeyframesAround(const MapView& map, std::span<const KeyframeId> keyframes,
                                             const LocalMapOptions& options = {});
template <class MapView>
LocalMap LocalMapOfKeyframes(const MapView& map, std::span<const KeyframeId> keyframes,
                             const LocalMapOptions& options = {});

// The descriptors of the observations of each point, at most `max_per_point` (the typical one and, of the others, those
// spread evenly over the observing keyframes).
template <class MapView>
DescriptorLists ObservedDescriptors(const MapView& map, std::span<const map::MapPoint* const> points,
                                    int max_per_point = 8);

}  // namespace cairn::tracking
