#include "tracking/graph_distance.h"

#include <functional>
#include <queue>
#include <utility>
#include <vector>

namespace cairn::tracking {

std::unordered_map<KeyframeId, double> KeyframesWithin(const map::Snapshot& map, KeyframeId from, double max_length) {
  std::unordered_map<KeyframeId, double> lengths;
  if (map.keyframes().Find(from) == nullptr) return lengths;
  // Dijkstra's algorithm; ends at the border.
  using Entry = std::pair<double, KeyframeId>;
  std::priority_queue<Entry, std::vector<Entry>, std::greater<>> open;
  open.emplace(0.0, from);
  while (!open.empty()) {
    const auto [length, id] = open.top();
    open.pop();
    if (!lengths.emplace(id, length).second) continue;
    const map::Keyframe& keyframe = map.keyframe(id);
    const Vector3d centre = keyframe.CenterInMap();
    const auto visit = [&, length = length](const map::Keyframe& other) {
      const double there = length + (other.CenterInMap() - centre).norm();
      if (there <= max_length && !lengths.contains(other.id)) open.emplace(there, other.id);
    };
    for (const map::CovisibilityEdge& edge : keyframe.covisible) {
      if (edge.shared_points < map::kMinCovisiblePoints) break;
      visit(map.keyframe(edge.keyframe));
    }
    const auto visit_tree = [&](KeyframeId other_id) {
      const map::Keyframe* other = other_id ? map.keyframes().Find(other_id) : nullptr;
      if (other == nullptr || other->session != keyframe.session) return;
      if (other->direct_segment == keyframe.direct_segment) visit(*other);
    };
    visit_tree(keyframe.parent);
    for (const KeyframeId child : keyframe.children) visit_tree(child);
  }
  return lengths;
}

}  // namespace cairn::tracking
