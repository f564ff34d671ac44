#include "mapping/culling.h"

#include <algorithm>

namespace cairn::mapping {

void PointCuller::Watch(std::span<const PointId> points, int keyframe_count) {
  for (const PointId point : points) watched_.push_back({point, keyframe_count});
}

int PointCuller::Cull(map::Edit& edit, int keyframe_count, const FeatureMapperOptions& options) {
  int culled = 0;
  std::erase_if(watched_, [&](const Entry& entry) {
    const map::MapPoint* point = edit.FindPoint(entry.point);
    if (point == nullptr) return true;
    const int age = keyframe_count - entry.born;
    const bool unfound = point->times_found < options.min_found_ratio * point->times_visible;
    const bool unseen =
        age >= options.young_keyframes - 1 && static_cast<int>(point->observations.size()) < options.min_observations;
    if (unfound || unseen) {
      edit.ErasePoint(entry.point);
      ++culled;
      return true;
    }
    return age >= options.young_keyframes;
  });
  return culled;
}

bool IsClutter(const map::MapPoint& point, const FeatureMapperOptions& options) {
  return point.times_visible >= options.judged_after &&
         point.times_found < options.min_found_ratio * point.times_visible;
}

double RedundantShare(const map::Edit& edit, KeyframeId id, int observers) {
  const map::Keyframe& keyframe = edit.keyframe(id);
  int points = 0, redundant = 0;
  for (std::size_t i = 0; i < keyframe.points.size(); ++i) {
    if (!keyframe.points[i]) continue;
    ++points;
    const map::MapPoint& point = edit.point(keyframe.points[i]);
    if (static_cast<int>(point.observations.size()) <= observers) continue;
    const int octave = keyframe.keypoints()[i].octave;
    int others = 0;
    for (const map::Observation& observation : point.observations) {
      if (observation.keyframe == id) continue;
      const int other = edit.keyframe(observation.keyframe).keypoints()[observation.feature].octave;
      if (other <= octave + 1 && ++others >= observers) break;
    }
    redundant += others >= observers ? 1 : 0;
  }
  return points > 0 ? static_cast<double>(redundant) / points : 0.0;
}

int CullKeyframes(map::Edit& edit, KeyframeId keyframe, const FeatureMapperOptions& options,
                  const std::function<bool(KeyframeId)>& erase) {
  int culled = 0;
  const std::vector<map::CovisibilityEdge> edges = edit.keyframe(keyframe).covisible;
  for (const map::CovisibilityEdge& edge : edges) {
    if (edge.shared_points < map::kMinCovisiblePoints) break;
    if (!edit.keyframe(edge.keyframe).parent) continue;  // a root stays
    if (RedundantShare(edit, edge.keyframe, options.redundant_observers) <= options.redundant_share) continue;
    if (erase(edge.keyframe)) ++culled;
  }
  return culled;
}

}  // namespace cairn::mapping
