#include "map/point_completion.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "map/viewing.h"

namespace cairn::map {
namespace {

// The map after a delta, as far as points need it.
class After {
 public:
  After(const Snapshot& base, const image::OrbParameters& orb, const Delta& delta)
      : base_(base), orb_(orb), delta_(delta), gone_(delta.removed_keyframes.begin(), delta.removed_keyframes.end()) {
    for (const auto& keyframe : delta.keyframes) changed_.emplace(keyframe->id, keyframe.get());
  }

  void FindObservations(const std::vector<std::shared_ptr<MapPoint>>& points) {
    observations_.reserve(points.size());
    for (const auto& point : points) {
      // Keyframes that are as they were observe what they did.
      std::vector<Observation>& seen = observations_[point->id];
      const MapPoint* before = base_.points().Find(point->id);
      if (before == nullptr) continue;
      for (const Observation& observation : before->observations) {
        if (!changed_.contains(observation.keyframe) && !gone_.contains(observation.keyframe)) {
          seen.push_back(observation);
        }
      }
    }
    for (const auto& keyframe : delta_.keyframes) {
      for (std::uint32_t i = 0; i < keyframe->points.size(); ++i) {
        if (!keyframe->points[i]) continue;
        const auto touched = observations_.find(keyframe->points[i]);
        if (touched != observations_.end()) touched->second.push_back({keyframe->id, i});
      }
    }
  }

  absl::Status Complete(MapPoint* point) {
    point->observations = std::move(observations_[point->id]);
    std::sort(point->observations.begin(), point->observations.end());
    seen_from_.clear();
    const Keyframe* reference = nullptr;
    for (const Observation& observation : point->observations) {
      const Keyframe* keyframe = Find(observation.keyframe);
      if (keyframe == nullptr || observation.feature >= keyframe->points.size()) {
        return Bad(*point, "a keyframe that observes the point is missing");
      }
      seen_from_.push_back(CenterOf(observation.keyframe));
      if (observation.keyframe != point->reference.keyframe) continue;
      point->reference = observation;
      reference = keyframe;
    }
    if (reference == nullptr) return Bad(*point, "the reference keyframe does not observe the point");
    const image::Features& features = look_.Of(reference->features).features;
    point->descriptor = features.descriptors[point->reference.feature];
    SetViewing(ComputeViewing(point->position, seen_from_, CenterOf(reference->id),
                              features.keypoints[point->reference.feature].octave, FocalOf(reference->camera), orb_),
               point);
    return absl::OkStatus();
  }

 private:
  static absl::Status Bad(const MapPoint& point, absl::string_view what) {
    return absl::DataLossError(absl::StrCat("point ", point.id.value(), ": ", what));
  }

  const Keyframe* Find(KeyframeId id) const {
    const auto changed = changed_.find(id);
    if (changed != changed_.end()) return changed->second;
    return gone_.contains(id) ? nullptr : base_.keyframes().Find(id);
  }

  const Vector3d& CenterOf(KeyframeId id) {
    const auto [at, is_new] = centers_.try_emplace(id);
    if (is_new) at->second = Find(id)->CenterInMap();
    return at->second;
  }

  double FocalOf(CameraId id) const {
    for (const MapCamera& camera : delta_.cameras) {
      if (camera.id == id) return camera.pinhole.fx_px;
    }
    const auto known = base_.cameras().find(id);
    return known == base_.cameras().end() ? 1.0 : known->second.pinhole.fx_px;
  }

  const Snapshot& base_;
  const image::OrbParameters& orb_;
  const Delta& delta_;
  const std::unordered_set<KeyframeId> gone_;
  std::unordered_map<KeyframeId, const Keyframe*> changed_;
  std::unordered_map<PointId, std::vector<Observation>> observations_;
  std::unordered_map<KeyframeId, Vector3d> centers_;
  FeatureLook look_;
  std::vector<Vector3d> seen_from_;
};

}  // namespace

absl::Status CompletePoints(const Snapshot& base, const image::OrbParameters& orb,
                            const std::vector<std::shared_ptr<MapPoint>>& points, Delta* delta) {
  After after(base, orb, *delta);
  after.FindObservations(points);
  delta->points.reserve(points.size());
  for (const auto& point : points) {
    CAIRN_RETURN_IF_ERROR(after.Complete(point.get()));
    delta->points.push_back(point);
  }
  return absl::OkStatus();
}

}  // namespace cairn::map
