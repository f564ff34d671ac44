// Large maps for tests and benchmarks of what grows with a map: the places of a real map again and again, which look
// like other places, or nearly alike.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/status.h"

namespace cairn::synth {

struct MapCopiesOptions {
  std::string like;      // the map whose components are copied
  int keyframes = 1000;  // at least so many
  // Each copy has a mask of its own over all descriptors: within it these are as far apart as in the original, and from
  // those of other copies as far as by chance. False: the copies look alike, but for `flipped_bits`.
  bool other_places = true;
  double flipped_bits = 0.1;  // of each descriptor, by chance: share of its 256 bits
  std::uint64_t seed = 1;
  bool overwrite = false;

  absl::Status Validate() const;
};

struct MapCopies {
  std::int64_t keyframes = 0;
  std::int64_t points = 0;
  int components = 0;
};

// Writes the map. The first copy of each component is exact, so that images of the place are located; copy k of it is a
// component of its own, aligned if the original is, k times the extent of all cameras further along x of frame world.
// `progress` is told keyframes done. Errors of the store; InvalidArgument for options that make no sense, or a map
// without keyframes or vocabulary.
absl::StatusOr<MapCopies> CopyMap(const MapCopiesOptions& options, const std::string& out,
                                  const std::function<void(std::int64_t)>& progress = {});

}  // namespace cairn::synth
