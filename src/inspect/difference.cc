#include "inspect/difference.h"

#include <algorithm>
#include <map>
#include <numbers>
#include <optional>
#include <unordered_map>
#include <utility>

#include "geometry/alignment.h"
#include "inspect/measures.h"

namespace cairn::inspect {

bool SameButForId(const map::Keyframe& a, const map::Keyframe& b) {
  return a.time_ns == b.time_ns && a.frame_index == b.frame_index &&
         a.camera_from_direct.rotation().coeffs() == b.camera_from_direct.rotation().coeffs() &&
         a.camera_from_direct.translation() == b.camera_from_direct.translation();
}

const map::Keyframe* SameKeyframe(const map::Keyframe& keyframe, const map::Snapshot& other) {
  const map::Keyframe* found = other.keyframes().Find(keyframe.id);
  return found != nullptr && SameButForId(*found, keyframe) ? found : nullptr;
}

namespace {

using ComponentPair = std::pair<ComponentId, ComponentId>;

struct Common {
  std::vector<Vector3d> first, second;  // centres
};

ComponentFit FitOf(const map::Snapshot& map, const ComponentPair& pair, const Common& common, bool align) {
  ComponentFit fit;
  fit.first = pair.first;
  fit.second = pair.second;
  fit.keyframes = static_cast<std::int64_t>(common.first.size());
  fit.metres = map.WorldFrom(pair.first).has_value();
  // What has not moved at all needs no fit, which would round.
  if (!align || common.first == common.second) return fit;
  const auto robust = AlignPointsRobust(common.first, common.second);
  if (!robust.ok()) return fit;
  fit.aligned = true;
  fit.first_from_second = robust->a_from_b;
  return fit;
}

bool SameAnchor(const std::optional<map::GeoAnchor>& a, const std::optional<map::GeoAnchor>& b) {
  if (!a || !b) return a.has_value() == b.has_value();
  return a->latitude_deg == b->latitude_deg && a->longitude_deg == b->longitude_deg && a->height_m == b->height_m &&
         a->enu_from_world.coeffs() == b->enu_from_world.coeffs();
}

class Comparison {
 public:
  Comparison(const map::Snapshot& first, const map::Snapshot& second, const DifferenceOptions& options)
      : first_(first), second_(second), options_(options) {}

  absl::StatusOr<MapDifference> Run() {
    CompareKeyframes();
    if (difference_.keyframes_kept == 0 && !first_.keyframes().empty() && !second_.keyframes().empty()) {
      if (HaveCommonUnderOtherIds()) {
        return absl::FailedPreconditionError(
            "the two have keyframes in common, but under other ids, as merging (cairn merge) and importing give them: "
            "only states of one map, or copies of one that went on, can be compared");
      }
      return absl::FailedPreconditionError(
          "the two have no keyframe in common: they are not states of one map, nor copies of one that went on "
          "(of one recording two runs make two maps; cairn merge joins such)");
    }
    ComparePoints();
    CompareHeads();
    CompareCameras();
    difference_.anchor_changed = !SameAnchor(first_.info().geo_anchor, second_.info().geo_anchor);
    return std::move(difference_);
  }

 private:
  void CompareKeyframes() {
    std::map<ComponentPair, Common> common;
    first_.keyframes().ForEach([&](const auto& keyframe) {
      difference_.observations_before += NumPoints(*keyframe);
      const map::Keyframe* other = SameKeyframe(*keyframe, second_);
      if (other == nullptr) {
        difference_.keyframes_removed.push_back(keyframe->id);
        return;
      }
      ++difference_.keyframes_kept;
      Common& pair = common[{keyframe->component, other->component}];
      pair.first.push_back(keyframe->CenterInMap());
      pair.second.push_back(other->CenterInMap());
    });
    for (const auto& [pair, centers] : common) {
      difference_.fits.push_back(FitOf(first_, pair, centers, options_.align));
      fits_[pair] = difference_.fits.back().first_from_second;
    }
    second_.keyframes().ForEach([&](const auto& keyframe) {
      difference_.observations_after += NumPoints(*keyframe);
      const map::Keyframe* before = SameKeyframe(*keyframe, first_);
      if (before == nullptr) {
        difference_.keyframes_added.push_back(keyframe->id);
        return;
      }
      const Sim3& fit = fits_.at({before->component, keyframe->component});
      const SE3 now = fit.TransformPose(keyframe->camera_from_map.Inverse());
      const double shift = (now.translation() - before->CenterInMap()).norm();
      const double turn = AngleRad((before->camera_from_map * now).rotation());
      difference_.keyframe_moves.push_back(
          {keyframe->id, shift * PlacedScale(first_, before->component),
           before->camera_from_map.rotation().coeffs() == keyframe->camera_from_map.rotation().coeffs()
               ? 0.0
               : turn * 180.0 / std::numbers::pi});
    });
    std::ranges::stable_sort(difference_.keyframe_moves, std::ranges::greater(), &KeyframeMove::shift);
  }

  bool HaveCommonUnderOtherIds() const {
    std::unordered_multimap<TimeNs, const map::Keyframe*> by_time;
    first_.keyframes().ForEach([&](const auto& keyframe) { by_time.emplace(keyframe->time_ns, keyframe.get()); });
    bool common = false;
    second_.keyframes().ForEach([&](const auto& keyframe) {
      const auto [begin, end] = by_time.equal_range(keyframe->time_ns);
      common |= std::any_of(begin, end, [&](const auto& entry) { return SameButForId(*entry.second, *keyframe); });
    });
    return common;
  }

  // A point of the second map that the first has as well: somebody sees it in both, by the same feature.
  const map::MapPoint* Now(const map::MapPoint& point) const {
    const map::MapPoint* now = second_.points().Find(point.id);
    if (now == nullptr) return nullptr;
    const auto sees_both = [&](const map::Observation& observation) {
      const map::Keyframe* keyframe = first_.keyframes().Find(observation.keyframe);
      const map::Keyframe* other = keyframe == nullptr ? nullptr : SameKeyframe(*keyframe, second_);
      if (other == nullptr) return false;
      const auto there = std::ranges::find(now->observations, keyframe->id, &map::Observation::keyframe);
      // Features have other numbers where some were left out.
      return there != now->observations.end() && keyframe->features->features.descriptors[observation.feature] ==
                                                     other->features->features.descriptors[there->feature];
    };
    return std::ranges::any_of(point.observations, sees_both) ? now : nullptr;
  }

  void ComparePoints() {
    first_.points().ForEach([&](const auto& point) {
      const map::MapPoint* now = Now(*point);
      const auto fit =
          now == nullptr ? fits_.end() : fits_.find({ComponentOf(first_, *point), ComponentOf(second_, *now)});
      if (fit == fits_.end()) {
        difference_.points_removed.push_back(point->id);
        return;
      }
      ++difference_.points_kept;
      const double shift = (fit->second * now->position - point->position).norm();
      difference_.point_moves.push_back({point->id, shift * PlacedScale(first_, ComponentOf(first_, *point))});
    });
    second_.points().ForEach([&](const auto& point) {
      const map::MapPoint* before = first_.points().Find(point->id);
      if (before == nullptr || Now(*before) == nullptr ||
          !fits_.contains({ComponentOf(first_, *before), ComponentOf(second_, *point)})) {
        difference_.points_added.push_back(point->id);
      }
    });
    std::ranges::stable_sort(difference_.point_moves, std::ranges::greater(), &PointMove::shift);
  }

  void CompareHeads() {
    for (const auto& [id, session] : second_.sessions()) {
      if (!first_.sessions().contains(id)) difference_.sessions_added.push_back(id);
    }
    for (const auto& [id, session] : first_.sessions()) {
      const auto now = second_.sessions().find(id);
      const bool gone = now == second_.sessions().end() || (now->second.removed && !session.removed);
      if (gone) difference_.sessions_removed.push_back(id);
    }
    const std::vector<ComponentId> before = first_.LiveComponents(), after = second_.LiveComponents();
    std::ranges::set_difference(after, before, std::back_inserter(difference_.components_added));
    std::ranges::set_difference(before, after, std::back_inserter(difference_.components_gone));
    for (const ComponentId id : after) {
      if (!std::ranges::binary_search(before, id)) continue;
      const map::Component &was = first_.component(id), &is = second_.component(id);
      map::Component as_was = is;
      as_was.world_from_component = was.world_from_component;
      if (!(as_was == is)) difference_.realigned.push_back(id);
    }
  }

  // In maps that went on apart one id may stand for two cameras: such a one is gone, and another is there.
  void CompareCameras() {
    for (const auto& [id, camera] : second_.cameras()) {
      const auto before = first_.cameras().find(id);
      if (before == first_.cameras().end() || !(before->second.model == camera.model)) {
        difference_.cameras_added.push_back(id);
      } else if (!(before->second == camera)) {
        difference_.cameras_changed.push_back(id);
      }
    }
    for (const auto& [id, camera] : first_.cameras()) {
      const auto now = second_.cameras().find(id);
      if (now == second_.cameras().end() || !(now->second.model == camera.model)) {
        difference_.cameras_removed.push_back(id);
      }
    }
  }

  const map::Snapshot& first_;
  const map::Snapshot& second_;
  const DifferenceOptions& options_;
  std::map<ComponentPair, Sim3> fits_;
  MapDifference difference_;
};

}  // namespace

bool MapDifference::same() const {
  const auto stays = [](const auto& move) { return move.shift == 0.0; };
  return keyframes_added.empty() && keyframes_removed.empty() && points_added.empty() && points_removed.empty() &&
         sessions_added.empty() && sessions_removed.empty() && components_added.empty() && components_gone.empty() &&
         realigned.empty() && cameras_added.empty() && cameras_removed.empty() && cameras_changed.empty() &&
         !anchor_changed && std::ranges::all_of(keyframe_moves, stays) && std::ranges::all_of(point_moves, stays) &&
         observations_before == observations_after;
}

absl::StatusOr<MapDifference> Compare(const map::Snapshot& first, const map::Snapshot& second,
                                      const DifferenceOptions& options) {
  return Comparison(first, second, options).Run();
}

}  // namespace cairn::inspect
