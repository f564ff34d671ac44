#include "mapping/grid_cache.h"

#include <algorithm>

namespace cairn::mapping {

const image::FeatureGrid& GridCache::Of(const map::Keyframe& keyframe, const Pinhole& pinhole) {
  Entry& entry = entries_[keyframe.id];
  entry.used = ++clock_;
  if (!entry.grid) {
    entry.grid = std::make_unique<image::FeatureGrid>(keyframe.keypoints(), pinhole.width_px, pinhole.height_px);
    if (entries_.size() > capacity_) {
      const auto oldest = std::min_element(entries_.begin(), entries_.end(),
                                           [](const auto& a, const auto& b) { return a.second.used < b.second.used; });
      entries_.erase(oldest);
    }
  }
  return *entries_[keyframe.id].grid;
}

}  // namespace cairn::mapping
