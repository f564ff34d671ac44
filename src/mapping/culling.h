// Keeps the map free of clutter (Mur-Artal et al., "ORB-SLAM", T-RO 2015, Sec. VI-B and VI-E): points that are not
// found where they should be seen, or that too few keyframes came to observe; keyframes that show nothing that others
// do not show as well.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "map/edit.h"
#include "mapping/feature_mapper_options.h"

namespace cairn::mapping {

// Watches points until they have proved themselves.
class PointCuller {
 public:
  void Watch(std::span<const PointId> points, int keyframe_count);
  // Erases the watched points that fail; `keyframe_count` counts the keyframes inserted so far. Returns how many.
  int Cull(map::Edit& edit, int keyframe_count, const FeatureMapperOptions& options);

 private:
  struct Entry {
    PointId point;
    int born = 0;
  };
  std::vector<Entry> watched_;
};

// What is rarely found where it was often to be seen is no landmark, however old: such points would keep alive
// keyframes that alone see them, and where a camera stays, both would pile up.
bool IsClutter(const map::MapPoint& point, const FeatureMapperOptions& options);

// Share of the points of a keyframe that at least `observers` others see at the same or a finer scale (one octave of
// slack). 0 without points.
double RedundantShare(const map::Edit& edit, KeyframeId keyframe, int observers);

// The keyframes around `keyframe` that can go, one after the other, given that the earlier ones went. They are erased
// by `erase`, which returns false to keep one.
int CullKeyframes(map::Edit& edit, KeyframeId keyframe, const Redundancy& limit,
                  const std::function<bool(KeyframeId)>& erase);

// Likewise among `keyframes`, wherever they are: the most redundant one first, until none is left.
int CullAmong(map::Edit& edit, std::vector<KeyframeId> keyframes, const Redundancy& limit,
              const std::function<bool(KeyframeId)>& erase);

}  // namespace cairn::mapping
