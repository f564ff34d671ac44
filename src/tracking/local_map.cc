#include "tracking/local_map.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>

#include "base/dense_ids.h"

namespace cairn::tracking {
namespace {

const map::Keyframe* FindKeyframe(const map::Snapshot& map, KeyframeId id) { return map.keyframes().Find(id); }
const map::Keyframe* FindKeyframe(const map::Edit& map, KeyframeId id) { return map.FindKeyframe(id); }
const map::MapPoint* FindPoint(const map::Snapshot& map, PointId id) { return map.points().Find(id); }
const map::MapPoint* FindPoint(const map::Edit& map, PointId id) { return map.FindPoint(id); }

// Keyframes in the order in which they were first added, up to a limit.
class KeyframeList {
 public:
  explicit KeyframeList(int limit) : limit_(static_cast<std::size_t>(limit)) {}

  bool full() const { return ids_.size() >= limit_; }
  const std::vector<KeyframeId>& ids() const { return ids_; }
  void Add(KeyframeId id) {
    if (id && !full() && known_.insert(id).second) ids_.push_back(id);
  }

 private:
  std::size_t limit_;
  std::vector<KeyframeId> ids_;
  std::unordered_set<KeyframeId> known_;
};

template <class MapView>
void AddNeighbours(const MapView& map, const LocalMapOptions& options, KeyframeList* list) {
  const std::size_t sharing = list->ids().size();
  for (std::size_t i = 0; i < sharing && !list->full(); ++i) {
    const map::Keyframe* keyframe = FindKeyframe(map, list->ids()[i]);
    if (options.neighbours_per_keyframe > 0) {
      for (const KeyframeId id : map::BestCovisible(*keyframe, options.neighbours_per_keyframe)) {
        if (FindKeyframe(map, id) != nullptr) list->Add(id);
      }
    }
    if (!options.tree_neighbours) continue;
    if (keyframe->parent && FindKeyframe(map, keyframe->parent) != nullptr) list->Add(keyframe->parent);
    for (const KeyframeId child : keyframe->children) {
      if (FindKeyframe(map, child) != nullptr) list->Add(child);
    }
  }
}

template <class MapView>
std::vector<const map::MapPoint*> PointsOf(const MapView& map, std::span<const KeyframeId> keyframes) {
  std::vector<PointId> ids;
  for (const KeyframeId id : keyframes) {
    for (const PointId point : FindKeyframe(map, id)->points) {
      if (point) ids.push_back(point);
    }
  }
  std::vector<const map::MapPoint*> points;
  SortUnique(&ids);
  points.reserve(ids.size());
  for (const PointId id : ids) {
    if (const map::MapPoint* point = FindPoint(map, id)) points.push_back(point);
  }
  return points;
}

// The keyframes that see given points, most first.
template <class MapView>
KeyframeList Sharing(const MapView& map, std::span<const PointId> seen, const LocalMapOptions& options) {
  std::unordered_map<KeyframeId, int> count_of;
  for (const PointId id : seen) {
    const map::MapPoint* point = FindPoint(map, id);
    if (point == nullptr) continue;
    for (const map::Observation& observation : point->observations) ++count_of[observation.keyframe];
  }
  std::vector<std::pair<int, KeyframeId>> sharing;
  for (const auto& [id, count] : count_of) {
    if (FindKeyframe(map, id) != nullptr) sharing.emplace_back(-count, id);
  }
  std::sort(sharing.begin(), sharing.end());
  KeyframeList list(options.max_keyframes);
  for (const auto& [count, id] : sharing) list.Add(id);
  return list;
}

template <class MapView>
KeyframeList Given(const MapView& map, std::span<const KeyframeId> keyframes, const LocalMapOptions& options) {
  KeyframeList list(options.max_keyframes);
  for (const KeyframeId id : keyframes) {
    if (FindKeyframe(map, id) != nullptr) list.Add(id);
  }
  return list;
}

template <class MapView>
LocalMap Complete(const MapView& map, const LocalMapOptions& options, KeyframeList list) {
  LocalMap local;
  local.num_sharing = list.ids().size();
  AddNeighbours(map, options, &list);
  local.keyframes = list.ids();
  local.points = PointsOf(map, local.keyframes);
  return local;
}

}  // namespace

absl::Status LocalMapOptions::Validate() const {
  if (max_keyframes < 1) return absl::InvalidArgumentError("local map: max_keyframes must be at least 1");
  if (neighbours_per_keyframe < 0) {
    return absl::InvalidArgumentError("local map: neighbours_per_keyframe must not be negative");
  }
  return absl::OkStatus();
}

template <class MapView>
LocalMap LocalMapOfPoints(const MapView& map, std::span<const PointId> seen, const LocalMapOptions& options) {
  return Complete(map, options, Sharing(map, seen, options));
}

template <class MapView>
std::vector<KeyframeId> LocalKeyframesOfPoints(const MapView& map, std::span<const PointId> seen,
                                               const LocalMapOptions& options) {
  KeyframeList list = Sharing(map, seen, options);
  AddNeighbours(map, options, &list);
  return list.ids();
}

template <class MapView>
LocalMap LocalMapOfKeyframes(const MapView& map, std::span<const KeyframeId> keyframes,
                             const LocalMapOptions& options) {
  return Complete(map, options, Given(map, keyframes, options));
}

template <class MapView>
std::vector<KeyframeId> LocalKeyframesAround(const MapView& map, std::span<const KeyframeId> keyframes,
                                             const LocalMapOptions& options) {
  KeyframeList list = Given(map, keyframes, options);
  AddNeighbours(map, options, &list);
  return list.ids();
}

template <class MapView>
DescriptorLists ObservedDescriptors(const MapView& map, std::span<const map::MapPoint* const> points,
                                    int max_per_point) {
  DescriptorLists lists;
  std::vector<map::Observation> others;
  map::FeatureLook look;
  lists.begin.reserve(points.size() + 1);
  for (const map::MapPoint* point : points) {
    if (point != nullptr) {
      lists.descriptors.push_back(point->descriptor);
      // Of the others, as many as there is room for, spread evenly so that they span all views.
      others.clear();
      for (const map::Observation& observation : point->observations) {
        if (observation != point->reference && FindKeyframe(map, observation.keyframe) != nullptr) {
          others.push_back(observation);
        }
      }
      const std::size_t count = std::min(others.size(), static_cast<std::size_t>(std::max(0, max_per_point - 1)));
      for (std::size_t i = 0; i < count; ++i) {
        const map::Observation& observation = others[i * others.size() / count];
        const map::KeyframeFeatures& features = look.Of(FindKeyframe(map, observation.keyframe)->features);
        lists.descriptors.push_back(features.features.descriptors[observation.feature]);
      }
    }
    lists.Close();
  }
  return lists;
}

template LocalMap LocalMapOfPoints(const map::Snapshot&, std::span<const PointId>, const LocalMapOptions&);
template LocalMap LocalMapOfPoints(const map::Edit&, std::span<const PointId>, const LocalMapOptions&);
template std::vector<KeyframeId> LocalKeyframesOfPoints(const map::Snapshot&, std::span<const PointId>,
                                                        const LocalMapOptions&);
template std::vector<KeyframeId> LocalKeyframesAround(const map::Snapshot&, std::span<const KeyframeId>,
                                                      const LocalMapOptions&);
template LocalMap LocalMapOfKeyframes(const map::Snapshot&, std::span<const KeyframeId>, const LocalMapOptions&);
template LocalMap LocalMapOfKeyframes(const map::Edit&, std::span<const KeyframeId>, const LocalMapOptions&);
template DescriptorLists ObservedDescriptors(const map::Snapshot&, std::span<const map::MapPoint* const>, int);
template DescriptorLists ObservedDescriptors(const map::Edit&, std::span<const map::MapPoint* const>, int);

}  // namespace cairn::tracking
