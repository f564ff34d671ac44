#include "map/region.h"

#include <algorithm>
#include <limits>
#include <map>
#include <queue>
#include <set>
#include <unordered_set>

namespace cairn::map {
namespace {

bool Contains(const std::vector<KeyframeId>& ids, KeyframeId id) { return std::ranges::binary_search(ids, id); }

std::vector<KeyframeId> Without(const std::vector<KeyframeId>& all, const std::vector<KeyframeId>& some) {
  std::vector<KeyframeId> rest;
  std::ranges::set_difference(all, some, std::back_inserter(rest));
  return rest;
}

KeyframeId Nearest(const Snapshot& map, ComponentId component, const Vector3d& center) {
  KeyframeId nearest;
  double least = std::numeric_limits<double>::infinity();
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (keyframe->component != component) return;
    const double distance = (keyframe->CenterInMap() - center).squaredNorm();
    if (distance < least) least = distance, nearest = keyframe->id;
  });
  return nearest;
}

bool ObservedBy(const MapPoint& point, const std::vector<KeyframeId>& keyframes) {
  return std::ranges::any_of(point.observations,
                             [&](const Observation& observation) { return Contains(keyframes, observation.keyframe); });
}

}  // namespace

std::vector<KeyframeId> KeyframesAround(const Snapshot& map, const RegionQuery& query) {
  std::vector<KeyframeId> seeds;
  for (const KeyframeId id : query.around) {
    if (map.keyframes().Contains(id)) seeds.push_back(id);
  }
  if (seeds.empty()) {
    const KeyframeId nearest = Nearest(map, map.Resolve(query.component), query.center);
    if (nearest) seeds.push_back(nearest);
  }
  std::unordered_set<KeyframeId> found;
  std::queue<KeyframeId> next;
  const auto most = static_cast<std::size_t>(std::max(query.max_keyframes, 0));
  const auto add = [&](KeyframeId id) {
    if (id && found.size() < most && found.insert(id).second) next.push(id);
  };
  for (const KeyframeId id : seeds) add(id);
  for (; !next.empty(); next.pop()) {
    const Keyframe& keyframe = map.keyframe(next.front());
    for (const CovisibilityEdge& edge : keyframe.covisible) add(edge.keyframe);
    // Where a map hangs together by the tree alone.
    add(keyframe.parent);
    for (const KeyframeId child : keyframe.children) add(child);
  }
  std::vector<KeyframeId> sorted(found.begin(), found.end());
  std::ranges::sort(sorted);
  return sorted;
}

ChangedRows RowsOfRegion(const std::vector<KeyframeId>& had, const ChangedRows& changed, const Snapshot& after,
                         const std::vector<KeyframeId>& has) {
  const std::vector<KeyframeId> entering = Without(has, had), leaving = Without(had, has);
  std::map<KeyframeId, ChangedKeyframe> keyframes;
  for (const ChangedKeyframe& keyframe : changed.keyframes) {
    if (Contains(had, keyframe.id) && Contains(has, keyframe.id)) keyframes[keyframe.id] = keyframe;
  }
  std::set<PointId> points;
  const auto touch = [&](const Keyframe& keyframe) {
    const auto link = [&](KeyframeId id) {
      if (id && Contains(has, id)) keyframes.try_emplace(id, ChangedKeyframe{id});
    };
    for (const CovisibilityEdge& edge : keyframe.covisible) link(edge.keyframe);
    link(keyframe.parent);
    for (const KeyframeId child : keyframe.children) link(child);
    for (const PointId point : keyframe.points) {
      if (point) points.insert(point);
    }
  };
  for (const std::vector<KeyframeId>* ids : {&entering, &leaving}) {
    for (const KeyframeId id : *ids) {
      // The links and points of one that has left the map are among what has changed.
      if (const Keyframe* keyframe = after.keyframes().Find(id)) touch(*keyframe);
    }
  }
  for (const KeyframeId id : entering) keyframes[id] = {id, true, true};
  for (const KeyframeId id : leaving) keyframes[id] = {id};
  for (const PointId id : changed.points) {
    const MapPoint* point = after.points().Find(id);
    if (point == nullptr || ObservedBy(*point, has) || ObservedBy(*point, had)) points.insert(id);
  }
  ChangedRows rows = changed;
  rows.keyframes.clear();
  for (const auto& [id, keyframe] : keyframes) rows.keyframes.push_back(keyframe);
  rows.points.assign(points.begin(), points.end());
  return rows;
}

Delta AllOf(const Snapshot& map) {
  Delta delta;
  delta.base = map.revision() - 1;
  delta.reason = "all";
  for (const auto& [id, camera] : map.cameras()) delta.cameras.push_back(camera);
  for (const auto& [id, session] : map.sessions()) delta.sessions.push_back(session);
  for (const auto& [id, component] : map.components()) delta.components.push_back(component);
  map.keyframes().ForEach([&](const auto& keyframe) { delta.keyframes.push_back(keyframe); });
  map.points().ForEach([&](const auto& point) { delta.points.push_back(point); });
  delta.next_keyframe = map.next_keyframe();
  delta.next_point = map.next_point();
  delta.next_camera = map.next_camera();
  delta.next_session = map.next_session();
  delta.next_component = map.next_component();
  return delta;
}

}  // namespace cairn::map
