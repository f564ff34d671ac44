// The head of a map, as those see it who change it: its newest revision, and the way to the next. Whoever owns it (the
// engine) serializes its editors; while one works, nobody else changes it.
#pragma once

#include <memory>
#include <unordered_map>

#include "base/status.h"
#include "map/delta.h"
#include "tracking/map_view.h"

namespace cairn::mapping {

// By how much lengths around keyframes have grown with a change: a correction, or a join with another component. Those
// not named have kept theirs.
using KeyframeScales = std::unordered_map<KeyframeId, double>;

class MapHead {
 public:
  virtual ~MapHead() = default;

  virtual const std::shared_ptr<const tracking::MapView>& View() const = 0;

  // Makes `delta`, a change of View(), the next revision, and tells everyone who keeps references into the map
  // (FeatureMapper::OnChange). An error leaves the head as it was; after one of the store no change is taken any more.
  virtual absl::Status Commit(map::Delta delta, const KeyframeScales& scales) = 0;
};

}  // namespace cairn::mapping
