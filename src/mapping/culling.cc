#include "mapping/culling.h"

#include <algorithm>
#include <cmath>
#include <utility>

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
  // A camera of a longer focal length sees finer at the same octave: its octaves count as what they would be here. That
  // a shorter one sees coarser is not held against it, or keyframes of the longest would never go.
  const auto octave_in = [&](const map::Keyframe& other, std::uint32_t feature) {
    const double octave = other.keypoints()[feature].octave;
    if (other.camera == keyframe.camera) return octave;
    const double ratio = edit.pinhole(keyframe.camera).fx_px / edit.pinhole(other.camera).fx_px;
    return octave + std::min(0.0, std::log(ratio) / std::log(edit.info().orb.scale_factor));
  };
  int points = 0, redundant = 0;
  for (std::size_t i = 0; i < keyframe.points.size(); ++i) {
    if (!keyframe.points[i]) continue;
    ++points;
    const map::MapPoint& point = edit.point(keyframe.points[i]);
    if (static_cast<int>(point.observations.size()) <= observers) continue;
    const double octave = keyframe.keypoints()[i].octave;
    int others = 0;
    for (const map::Observation& observation : point.observations) {
      if (observation.keyframe == id) continue;
      const double other = octave_in(edit.keyframe(observation.keyframe), observation.feature);
      if (other <= octave + 1.0 && ++others >= observers) break;
    }
    redundant += others >= observers ? 1 : 0;
  }
  return points > 0 ? static_cast<double>(redundant) / points : 0.0;
}

int CullKeyframes(map::Edit& edit, KeyframeId keyframe, const Redundancy& limit,
                  const std::function<bool(KeyframeId)>& erase) {
  int culled = 0;
  const std::vector<map::CovisibilityEdge> edges = edit.keyframe(keyframe).covisible;
  for (const map::CovisibilityEdge& edge : edges) {
    if (edge.shared_points < map::kMinCovisiblePoints) break;
    if (!edit.keyframe(edge.keyframe).parent) continue;  // a root stays
    if (RedundantShare(edit, edge.keyframe, limit.observers) <= limit.share) continue;
    if (erase(edge.keyframe)) ++culled;
  }
  return culled;
}

int CullAmong(map::Edit& edit, std::vector<KeyframeId> keyframes, const Redundancy& limit,
              const std::function<bool(KeyframeId)>& erase) {
  int culled = 0;
  for (;;) {
    std::pair<double, KeyframeId> most = {limit.share, KeyframeId()};
    std::erase_if(keyframes,
                  [&](KeyframeId id) { return edit.FindKeyframe(id) == nullptr || !edit.keyframe(id).parent; });
    std::erase_if(keyframes, [&](KeyframeId id) {
      const double share = RedundantShare(edit, id, limit.observers);
      if (share > most.first) most = {share, id};
      return share <= limit.share;  // what goes makes nothing more redundant
    });
    if (!most.second) return culled;
    if (erase(most.second)) {
      ++culled;
    } else {
      std::erase(keyframes, most.second);
    }
  }
}

}  // namespace cairn::mapping
