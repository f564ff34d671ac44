#include "map/plausibility.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <unordered_map>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"

namespace cairn::map {
namespace {

using Sink = std::function<void(Implausibility)>;

struct WrongCounts {
  int observations = 0;
  int behind = 0;
  int off = 0;  // in front, but elsewhere than where it was seen
};

WrongCounts CountWrong(const Snapshot& map, const Keyframe& keyframe, double max_error_rad) {
  const Pinhole& camera = map.pinhole(keyframe.camera);
  const auto features = keyframe.features.Get();
  WrongCounts counts;
  for (std::size_t i = 0; i < keyframe.points.size(); ++i) {
    if (!keyframe.points[i]) continue;
    ++counts.observations;
    const Vector3d point_c = keyframe.camera_from_map * map.point(keyframe.points[i]).position;
    if (point_c.z() <= 0.0) {
      ++counts.behind;
      continue;
    }
    const image::Keypoint& keypoint = features->features.keypoints[i];
    const Vector3d seen = camera.Unproject({keypoint.x_px, keypoint.y_px});
    const double error_rad = std::atan2(seen.cross(point_c).norm(), seen.dot(point_c));
    counts.off += error_rad > max_error_rad ? 1 : 0;
  }
  return counts;
}

void CheckView(const Snapshot& map, const Keyframe& keyframe, const PlausibilityOptions& options, const Sink& sink) {
  const WrongCounts counts = CountWrong(map, keyframe, options.max_error_rad);
  const int wrong = counts.behind + counts.off;
  if (wrong < options.min_wrong || wrong < options.max_wrong_share * counts.observations) return;
  sink({"keyframes", keyframe.id.value(),
        absl::StrFormat("of the %d points that it observes %d are behind the camera and %d more than %.0f degrees "
                        "from where they were seen: its pose, camera or points are wrong",
                        counts.observations, counts.behind, counts.off, options.max_error_rad * 180.0 / M_PI)});
}

// Which keyframes hang together, by covisibility or by the spanning tree: a disjoint-set forest with path
// halving (Tarjan and van Leeuwen, "Worst-case analysis of set union algorithms", 1984).
class Links {
 public:
  void Take(const Keyframe& keyframe) {
    if (keyframe.parent) Join(keyframe.id, keyframe.parent);
    for (const CovisibilityEdge& edge : keyframe.covisible) Join(keyframe.id, edge.keyframe);
    of_component_[keyframe.component].push_back(keyframe.id);
  }

  void Check(const Sink& sink) {
    for (const auto& [component, keyframes] : of_component_) {
      const KeyframeId first = Top(keyframes.front());
      const auto linked = std::ranges::count_if(keyframes, [&](KeyframeId id) { return Top(id) == first; });
      const auto all = std::ssize(keyframes);
      if (linked == all) continue;
      sink({"components", component.value(),
            absl::StrCat("does not hang together: keyframe ", keyframes.front().value(), " is linked to ", linked - 1,
                         " of the ", all - 1, " others, so that their places to each other are not known")});
    }
  }

 private:
  void Join(KeyframeId a, KeyframeId b) {
    a = Top(a);
    above_[a] = Top(b);
  }
  KeyframeId Top(KeyframeId id) {
    while (true) {
      KeyframeId& above = above_.try_emplace(id, id).first->second;
      if (above == id) return id;
      above = above_.at(above);
      id = above;
    }
  }

  std::unordered_map<KeyframeId, KeyframeId> above_;  // itself at the top
  std::map<ComponentId, std::vector<KeyframeId>> of_component_;
};

}  // namespace

absl::Status PlausibilityOptions::Validate() const {
  if (!(max_error_rad > 0.0) || !(max_wrong_share > 0.0 && max_wrong_share <= 1.0) || min_wrong < 1) {
    return absl::InvalidArgumentError(
        "plausibility: max_error_rad and min_wrong must be positive, max_wrong_share within (0, 1]");
  }
  return absl::OkStatus();
}

absl::Status FindImplausible(const Snapshot& map, const PlausibilityOptions& options, const Sink& sink) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  Links links;
  ForEachKeyframe(map, options.source_bytes, [&](const Snapshot& around, const Keyframe& keyframe) {
    CheckView(around, keyframe, options, sink);
    links.Take(keyframe);
  });
  links.Check(sink);
  return absl::OkStatus();
}

}  // namespace cairn::map
