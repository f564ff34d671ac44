// Grids over the features of keyframes, made when first asked for and kept for those used lately.
#pragma once

#include <cstdint>
#include <memory>
#include <unordered_map>

#include "image/matching.h"
#include "map/entities.h"

namespace cairn::mapping {

class GridCache {
 public:
  explicit GridCache(std::size_t capacity = 128) : capacity_(capacity) {}

  // Valid until `capacity` other keyframes have been asked for.
  const image::FeatureGrid& Of(const map::Keyframe& keyframe, const Pinhole& pinhole);

 private:
  struct Entry {
    std::uint64_t used = 0;
    std::unique_ptr<image::FeatureGrid> grid;
  };
  std::size_t capacity_;
  std::uint64_t clock_ = 0;
  std::unordered_map<KeyframeId, Entry> entries_;
};

}  // namespace cairn::mapping
