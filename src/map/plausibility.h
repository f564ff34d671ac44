// Whether a map that is consistent (Snapshot::CheckConsistency) also makes sense: cameras see what lies before them,
// where they saw it, and a component hangs together. A map that Cairn made does; a program that wrote good checksums
// over wrong numbers, or a fault of Cairn's own, is found here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>

#include "map/snapshot.h"

namespace cairn::map {

struct PlausibilityOptions {
  // An observation counts as wrong where the point is behind the camera, or off its keypoint by more than this: far
  // beyond any error of matching, and far less than by chance.
  double max_error_rad = 0.05;
  // Shares of wrong observations of one keyframe from which it is told: single bad matches are part of every map.
  double max_wrong_share = 0.2;
  int min_wrong = 10;
  // Of keyframes and points that come from a source (map/entity_source.h) so much stays in memory.
  std::size_t source_bytes = std::size_t{32} << 20;
  absl::Status Validate() const;
};

// Something that cannot be; `kind` and `id` name it as the tables of a map file do ("keyframes" 12, "components" 1).
struct Implausibility {
  std::string kind;
  std::int64_t id = 0;
  std::string message;
};

// Tells `sink` of everything of that kind. O(map) in time.
absl::Status FindImplausible(const Snapshot& map, const PlausibilityOptions& options,
                             const std::function<void(Implausibility)>& sink);

}  // namespace cairn::map
