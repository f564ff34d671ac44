// A map as small as one that is only asked "where is this camera?" can be: what relocalization does not need is left
// out. Features that no point was made of are; of a point that many keyframes saw only those sightings are kept that
// tell most of how it looks; so are no histories.
//
// A packed map is a map like others, only that a session that extends it has less to hold on to.
#pragma once

#include <cstdint>
#include <memory>

#include "base/status.h"
#include "map/snapshot.h"

namespace cairn::care {

struct PackOptions {
  // Of a point: as many as relocalization compares a feature with
  // (tracking::RelocalizerOptions::descriptors_per_point).
  int max_sightings = 3;
  // A keyframe keeps so many features with a point, if it has them, whatever other keyframes saw of the same.
  int min_features = 150;

  absl::Status Validate() const;
};

struct Packed {
  std::shared_ptr<const map::Snapshot> map;  // of its own, at revision 1, with the ids of the one that was packed
  std::int64_t features_before = 0, features_after = 0;
};

// `info`: of the map to be. The name of the map and what was done are the caller's to tell.
absl::StatusOr<Packed> Pack(const map::Snapshot& map, const map::MapInfo& info, const PackOptions& options = {});

}  // namespace cairn::care
