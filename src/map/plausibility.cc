#include "map/plausibility.h"

#include <cmath>
#include <set>
#include <unordered_set>
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

void CheckViews(const Snapshot& map, const PlausibilityOptions& options, const Sink& sink) {
  map.keyframes().ForEach([&](const auto& keyframe) {
    const WrongCounts counts = CountWrong(map, *keyframe, options.max_error_rad);
    const int wrong = counts.behind + counts.off;
    if (wrong < options.min_wrong || wrong < options.max_wrong_share * counts.observations) return;
    sink({"keyframes", keyframe->id.value(),
          absl::StrFormat("of the %d points that it observes %d are behind the camera and %d more than %.0f degrees "
                          "from where they were seen: its pose, camera or points are wrong",
                          counts.observations, counts.behind, counts.off, options.max_error_rad * 180.0 / M_PI)});
  });
}

// Keyframes that hang together with `first` by covisibility or by the spanning tree.
std::size_t CountLinked(const Snapshot& map, const Keyframe& first, std::unordered_set<KeyframeId>* reached) {
  std::vector<const Keyframe*> waiting{&first};
  reached->insert(first.id);
  std::size_t count = 0;
  const auto reach = [&](KeyframeId id) {
    if (id && reached->insert(id).second) waiting.push_back(&map.keyframe(id));
  };
  while (!waiting.empty()) {
    const Keyframe& keyframe = *waiting.back();
    waiting.pop_back();
    ++count;
    reach(keyframe.parent);
    for (const KeyframeId child : keyframe.children) reach(child);
    for (const CovisibilityEdge& edge : keyframe.covisible) reach(edge.keyframe);
  }
  return count;
}

void CheckComponents(const Snapshot& map, const Sink& sink) {
  std::unordered_set<KeyframeId> reached;
  std::set<ComponentId> seen;
  map.keyframes().ForEach([&](const auto& keyframe) {
    if (!seen.insert(keyframe->component).second) return;
    const std::size_t linked = CountLinked(map, *keyframe, &reached);
    const auto all = static_cast<std::size_t>(map.NumKeyframes(keyframe->component));
    if (linked == all) return;
    sink({"components", keyframe->component.value(),
          absl::StrCat("does not hang together: keyframe ", keyframe->id.value(), " is linked to ", linked - 1,
                       " of the ", all - 1, " others, so that their places to each other are not known")});
  });
}

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
  CheckViews(map, options, sink);
  CheckComponents(map, sink);
  return absl::OkStatus();
}

}  // namespace cairn::map
