#include "tracking/local_point_cache.h"

#include <algorithm>
#include <iterator>

#include "tracking/local_map.h"

namespace cairn::tracking {
namespace {

// Keyframes that are kept beside those that are asked for: of a hundred so many.
constexpr std::size_t kMostBeside = 50;

bool Contains(const std::vector<KeyframeId>& sorted, std::span<const KeyframeId> wanted) {
  return std::all_of(wanted.begin(), wanted.end(),
                     [&](KeyframeId id) { return std::binary_search(sorted.begin(), sorted.end(), id); });
}

}  // namespace

std::span<const map::MapPoint* const> LocalPointCache::PointsOf(const map::Snapshot& map,
                                                                std::span<const KeyframeId> keyframes) {
  const std::size_t most = keyframes.size() * (100 + kMostBeside) / 100;
  if (keyframes_.size() <= most && Contains(keyframes_, keyframes)) return points_;
  std::vector<KeyframeId> wanted(keyframes.begin(), keyframes.end());
  std::sort(wanted.begin(), wanted.end());
  wanted.erase(std::unique(wanted.begin(), wanted.end()), wanted.end());
  std::vector<KeyframeId> both;
  std::set_union(wanted.begin(), wanted.end(), keyframes_.begin(), keyframes_.end(), std::back_inserter(both));
  keyframes_ = both.size() <= most ? std::move(both) : std::move(wanted);
  LocalMapOptions these;
  these.max_keyframes = static_cast<int>(std::max<std::size_t>(1, keyframes_.size()));
  these.neighbours_per_keyframe = 0;
  these.tree_neighbours = false;
  points_ = LocalMapOfKeyframes(map, keyframes_, these).points;
  return points_;
}

}  // namespace cairn::tracking
