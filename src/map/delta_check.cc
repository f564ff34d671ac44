#include "map/delta_check.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "map/delta_ids.h"

namespace cairn::map {
namespace {

absl::Status Broken(const std::string& what) {
  return absl::DataLossError(absl::StrCat("the map is inconsistent: ", what));
}
absl::Status Rejected(absl::string_view what) {
  return absl::InvalidArgumentError(absl::StrCat("change rejected: ", what));
}

std::string Name(KeyframeId id) { return absl::StrCat("keyframe ", id.value()); }
std::string Name(PointId id) { return absl::StrCat("point ", id.value()); }
std::string Name(CameraId id) { return absl::StrCat("camera ", id.value()); }
std::string Name(SessionId id) { return absl::StrCat("session ", id.value()); }
std::string Name(ComponentId id) { return absl::StrCat("component ", id.value()); }

// --- the delta by itself ---

// Ascending, so that none comes twice, and below the next free id.
template <class Items, class IdType>
absl::Status CheckIds(const Items& items, IdType next, absl::string_view what) {
  IdType last;
  for (const auto& item : items) {
    const IdType id = IdOf(item);
    if (!(last < id) || !(id < next)) {
      return Rejected(absl::StrCat("its ", what, " are not in ascending order of valid ids"));
    }
    last = id;
  }
  return absl::OkStatus();
}

// What is removed is in the map and not put as well. Both in order.
template <class Removed, class Put, class Known>
absl::Status CheckRemoved(const Removed& removed, const Put& put, Known known) {
  auto next = put.begin();
  for (const auto id : removed) {
    if (!known(id)) return Rejected(Name(id) + " to be removed is not there");
    while (next != put.end() && IdOf(*next) < id) ++next;
    if (next != put.end() && IdOf(*next) == id) return Rejected(Name(id) + " is put and removed");
  }
  return absl::OkStatus();
}

// Ids are never used twice: what is put is in the map, or has an id that was not given out before.
template <class Put, class IdType, class Known>
absl::Status CheckPut(const Put& put, IdType next_before, Known known) {
  for (const auto& item : put) {
    const IdType id = IdOf(item);
    if (id < next_before && !known(id)) return Rejected(Name(id) + " was removed earlier, or never existed");
  }
  return absl::OkStatus();
}

bool IsUnit(const Quaterniond& rotation) { return std::abs(rotation.norm() - 1.0) < 1e-6; }
bool IsGood(const SE3& pose) {
  return pose.translation().allFinite() && pose.rotation().coeffs().allFinite() && IsUnit(pose.rotation());
}
bool IsGood(const Sim3& similarity) {
  return similarity.translation().allFinite() && similarity.rotation().coeffs().allFinite() &&
         IsUnit(similarity.rotation()) && std::isfinite(similarity.scale()) && similarity.scale() > 0.0;
}

absl::Status CheckFeatures(const Keyframe& keyframe, const image::OrbParameters& orb) {
  const image::Features& features = keyframe.features->features;
  if (features.descriptors.size() != features.keypoints.size()) {
    return Rejected(Name(keyframe.id) + " does not have one descriptor per keypoint");
  }
  if (!keyframe.features->words.empty() && keyframe.features->words.size() != features.keypoints.size()) {
    return Rejected(Name(keyframe.id) + " has neither one word per keypoint nor none");
  }
  for (const image::Keypoint& keypoint : features.keypoints) {
    if (!std::isfinite(keypoint.x_px) || !std::isfinite(keypoint.y_px) || !std::isfinite(keypoint.angle_rad)) {
      return Rejected(Name(keyframe.id) + " has a keypoint that is not finite");
    }
    if (keypoint.octave >= orb.num_levels) {
      return Rejected(absl::StrCat(Name(keyframe.id), " has a keypoint of octave ", int{keypoint.octave},
                                   ", but the map has ", orb.num_levels));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckValues(const Snapshot& before, const Delta& delta, const Keyframe& keyframe) {
  if (!keyframe.features || keyframe.points.size() != keyframe.features.size()) {
    return Rejected(Name(keyframe.id) + " does not have one point entry per feature");
  }
  if (!IsGood(keyframe.camera_from_map) || !IsGood(keyframe.camera_from_direct)) {
    return Rejected(Name(keyframe.id) + " has a pose that is not a rigid transform");
  }
  const image::OrbParameters& orb = (delta.info ? *delta.info : before.info()).orb;
  const Keyframe* known = before.keyframes().Find(keyframe.id);
  // What comes when it is needed is checked when it is read.
  if (!keyframe.features.in_memory()) return absl::OkStatus();
  if (known == nullptr) return CheckFeatures(keyframe, orb);
  if (known->features == keyframe.features) return absl::OkStatus();
  const bool moved = std::binary_search(delta.moved_keypoints.begin(), delta.moved_keypoints.end(), keyframe.id);
  const auto& was = known->features->features;
  const auto& is = keyframe.features->features;
  const bool same_but_keypoints =
      was.descriptors == is.descriptors && known->features->words == keyframe.features->words;
  if (!same_but_keypoints || (!moved && was.keypoints != is.keypoints)) {
    return Rejected(absl::StrCat("the features of ", Name(keyframe.id), " changed"));
  }
  return moved ? CheckFeatures(keyframe, orb) : absl::OkStatus();
}

absl::Status CheckInfo(const MapInfo& before, const MapInfo& after, bool has_keyframes) {
  if (before.id != after.id) return Rejected("the id of a map never changes");
  if (has_keyframes && !(before.orb == after.orb)) return Rejected("the ORB parameters of its keyframes never change");
  if (has_keyframes && before.vocabulary_hash != after.vocabulary_hash) {
    return Rejected("its keyframes refer to the words of another vocabulary");
  }
  if (after.geo_anchor) CAIRN_RETURN_IF_ERROR(Annotate(after.geo_anchor->Validate(), "change rejected"));
  return absl::OkStatus();
}

absl::Status CheckCamera(const MapCamera& camera) {
  CAIRN_RETURN_IF_ERROR(Annotate(camera.model.Validate(), "change rejected: " + Name(camera.id)));
  CAIRN_RETURN_IF_ERROR(
      Annotate(Camera::FromPinhole(camera.pinhole).Validate(), "change rejected: pinhole of " + Name(camera.id)));
  return camera.lens ? Annotate(camera.lens->Validate(), "change rejected") : absl::OkStatus();
}

absl::Status CheckComponent(const Component& component) {
  if (component.world_from_component && !IsGood(*component.world_from_component)) {
    return Rejected("world_from_component of " + Name(component.id) + " is not a similarity transform");
  }
  if (!component.joined) return absl::OkStatus();
  if (!IsGood(component.joined->into_from_component)) {
    return Rejected("the join of " + Name(component.id) + " is not a similarity transform");
  }
  if (component.joined->into == component.id) return Rejected(Name(component.id) + " is joined to itself");
  return absl::OkStatus();
}

// --- the map after it ---

// The points that a change puts or removes.
class TouchedPoints {
 public:
  explicit TouchedPoints(const Delta& delta) {
    std::uint32_t last = 0;
    first_ = std::numeric_limits<std::uint32_t>::max();
    const auto cover = [&](PointId id) { first_ = std::min(first_, id.value()), last = std::max(last, id.value()); };
    for (const auto& point : delta.points) cover(point->id);
    for (const PointId id : delta.removed_points) cover(id);
    if (last == 0) return;
    touched_.assign(last - first_ + std::size_t{1}, false);
    for (const auto& point : delta.points) touched_[point->id.value() - first_] = true;
    for (const PointId id : delta.removed_points) touched_[id.value() - first_] = true;
  }
  bool Contains(PointId id) const {
    const std::uint32_t at = id.value() - first_;  // wraps far beyond the end if below
    return at < touched_.size() && touched_[at];
  }

 private:
  std::uint32_t first_ = 0;
  std::vector<bool> touched_;
};

bool Observes(const MapPoint& point, const Observation& observation) {
  return std::binary_search(point.observations.begin(), point.observations.end(), observation);
}
bool Lists(const std::vector<CovisibilityEdge>& edges, KeyframeId keyframe) {
  return std::ranges::find(edges, keyframe, &CovisibilityEdge::keyframe) != edges.end();
}

// same(i) tells which features need no look.
template <class Same>
absl::Status CheckObserved(const Snapshot& map, const Keyframe& keyframe, Same same) {
  for (std::uint32_t i = 0; i < keyframe.points.size(); ++i) {
    if (!keyframe.points[i] || same(i)) continue;
    const MapPoint* point = map.points().Find(keyframe.points[i]);
    if (point == nullptr) {
      return Broken(absl::StrCat(Name(keyframe.id), " observes missing ", Name(keyframe.points[i])));
    }
    if (!Observes(*point, {keyframe.id, i})) {
      return Broken(absl::StrCat(Name(point->id), " does not know that ", Name(keyframe.id), " observes it"));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckLinks(const Snapshot& map, const Keyframe& keyframe) {
  if (!map.cameras().contains(keyframe.camera)) return Broken(Name(keyframe.id) + " has an unknown camera");
  if (!map.sessions().contains(keyframe.session)) return Broken(Name(keyframe.id) + " has an unknown session");
  const auto component = map.components().find(keyframe.component);
  if (component == map.components().end()) return Broken(Name(keyframe.id) + " has an unknown component");
  if (component->second.joined) {
    return Broken(absl::StrCat(Name(keyframe.id), " is in ", Name(keyframe.component), ", which has been joined to ",
                               Name(component->second.joined->into)));
  }
  if (!keyframe.features || keyframe.points.size() != keyframe.features.size()) {
    return Broken(Name(keyframe.id) + " does not have one point entry per feature");
  }
  const auto elsewhere = [&](const Keyframe& other) {
    return Broken(absl::StrCat(Name(keyframe.id), " of ", Name(keyframe.component), " is linked to ", Name(other.id),
                               " of ", Name(other.component)));
  };
  if (keyframe.parent) {
    const Keyframe* parent = map.keyframes().Find(keyframe.parent);
    if (parent == nullptr) return Broken(Name(keyframe.id) + " has a missing parent");
    if (!std::binary_search(parent->children.begin(), parent->children.end(), keyframe.id)) {
      return Broken(Name(parent->id) + " does not list its child " + Name(keyframe.id));
    }
    if (parent->component != keyframe.component) return elsewhere(*parent);
  }
  for (const KeyframeId child : keyframe.children) {
    const Keyframe* found = map.keyframes().Find(child);
    if (found == nullptr || found->parent != keyframe.id) return Broken(Name(keyframe.id) + " lists a wrong child");
    if (found->component != keyframe.component) return elsewhere(*found);
  }
  for (std::size_t i = 0; i < keyframe.covisible.size(); ++i) {
    const CovisibilityEdge& edge = keyframe.covisible[i];
    const Keyframe* other = map.keyframes().Find(edge.keyframe);
    const CovisibilityEdge back{keyframe.id, edge.shared_points};
    if (other == nullptr || edge.keyframe == keyframe.id ||
        std::find(other->covisible.begin(), other->covisible.end(), back) == other->covisible.end()) {
      return Broken(
          absl::StrCat("the covisibility of ", Name(keyframe.id), " and ", Name(edge.keyframe), " is not symmetric"));
    }
    if (other->component != keyframe.component) return elsewhere(*other);
  }
  return absl::OkStatus();
}

// That nothing in the map after still refers to a link that `before` had and `after` (null: removed) has not.
absl::Status CheckDropped(const Snapshot& map, const Keyframe& before, const Keyframe* after) {
  const auto still = [&](const std::string& who) {
    return Rejected(
        absl::StrCat(who, " still refers to ", Name(before.id), after == nullptr ? ", which is removed" : ""));
  };
  for (std::uint32_t i = 0; i < before.points.size(); ++i) {
    if (!before.points[i] || (after != nullptr && i < after->points.size() && after->points[i] == before.points[i])) {
      continue;
    }
    const MapPoint* point = map.points().Find(before.points[i]);
    if (point != nullptr && Observes(*point, {before.id, i})) return still(Name(point->id));
  }
  if (after == nullptr || after->covisible != before.covisible) {
    for (const CovisibilityEdge& edge : before.covisible) {
      if (after != nullptr && Lists(after->covisible, edge.keyframe)) continue;
      const Keyframe* other = map.keyframes().Find(edge.keyframe);
      if (other != nullptr && Lists(other->covisible, before.id)) return still(Name(other->id));
    }
  }
  if (before.parent && (after == nullptr || after->parent != before.parent)) {
    const Keyframe* parent = map.keyframes().Find(before.parent);
    if (parent != nullptr && std::binary_search(parent->children.begin(), parent->children.end(), before.id)) {
      return still(Name(parent->id));
    }
  }
  for (const KeyframeId child_id : before.children) {
    if (after != nullptr && std::binary_search(after->children.begin(), after->children.end(), child_id)) continue;
    const Keyframe* child = map.keyframes().Find(child_id);
    if (child != nullptr && child->parent == before.id) return still(Name(child->id));
  }
  return absl::OkStatus();
}

absl::Status CheckDropped(const Snapshot& map, const MapPoint& before, const MapPoint* after) {
  for (const Observation& observation : before.observations) {
    if (after != nullptr && Observes(*after, observation)) continue;
    const Keyframe* keyframe = map.keyframes().Find(observation.keyframe);
    if (keyframe == nullptr || observation.feature >= keyframe->points.size()) continue;
    if (keyframe->points[observation.feature] == before.id) {
      return Rejected(absl::StrCat(Name(keyframe->id), " still observes ", Name(before.id),
                                   after == nullptr ? ", which is removed" : ""));
    }
  }
  return absl::OkStatus();
}

// Of a map that is new as a whole: that the points are well, and known to all features that observe them. A point that
// is well has observations of features that have it, and a feature has one point: no feature is left out if there are
// as many of the one as of the other. That takes a fraction of looking every feature's point up.
bool PointsAgreeWithKeyframes(const Snapshot& map, const Delta& all) {
  std::size_t observations = 0, observing = 0;
  for (const auto& point : all.points) {
    if (!CheckPoint(map, *point).ok()) return false;
    observations += point->observations.size();
  }
  for (const auto& keyframe : all.keyframes) {
    observing += keyframe->points.size() - static_cast<std::size_t>(std::ranges::count(keyframe->points, PointId()));
  }
  return observations == observing;
}

absl::Status AsRejection(const absl::Status& status) { return status.ok() ? status : Rejected(status.message()); }

}  // namespace

absl::Status CheckDelta(const Snapshot& before, const Delta& delta) {
  const auto next = [](auto known, auto given) { return std::max(known, given); };
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.cameras, next(before.next_camera(), delta.next_camera), "cameras"));
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.sessions, next(before.next_session(), delta.next_session), "sessions"));
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.components, next(before.next_component(), delta.next_component), "components"));
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.keyframes, next(before.next_keyframe(), delta.next_keyframe), "keyframes"));
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.points, next(before.next_point(), delta.next_point), "points"));
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.removed_cameras, before.next_camera(), "removed cameras"));
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.removed_components, before.next_component(), "removed components"));
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.removed_keyframes, before.next_keyframe(), "removed keyframes"));
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.removed_points, before.next_point(), "removed points"));

  const auto has_camera = [&](CameraId id) { return before.cameras().contains(id); };
  const auto has_session = [&](SessionId id) { return before.sessions().contains(id); };
  const auto has_component = [&](ComponentId id) { return before.components().contains(id); };
  const auto has_keyframe = [&](KeyframeId id) { return before.keyframes().Contains(id); };
  const auto has_point = [&](PointId id) { return before.points().Contains(id); };
  CAIRN_RETURN_IF_ERROR(CheckRemoved(delta.removed_cameras, delta.cameras, has_camera));
  CAIRN_RETURN_IF_ERROR(CheckRemoved(delta.removed_components, delta.components, has_component));
  CAIRN_RETURN_IF_ERROR(CheckRemoved(delta.removed_keyframes, delta.keyframes, has_keyframe));
  CAIRN_RETURN_IF_ERROR(CheckRemoved(delta.removed_points, delta.points, has_point));
  CAIRN_RETURN_IF_ERROR(CheckPut(delta.cameras, before.next_camera(), has_camera));
  CAIRN_RETURN_IF_ERROR(CheckPut(delta.sessions, before.next_session(), has_session));
  CAIRN_RETURN_IF_ERROR(CheckPut(delta.components, before.next_component(), has_component));
  CAIRN_RETURN_IF_ERROR(CheckPut(delta.keyframes, before.next_keyframe(), has_keyframe));
  CAIRN_RETURN_IF_ERROR(CheckPut(delta.points, before.next_point(), has_point));

  auto put = delta.keyframes.begin();
  for (const KeyframeId id : delta.moved_keypoints) {
    while (put != delta.keyframes.end() && (*put)->id < id) ++put;
    if (put == delta.keyframes.end() || (*put)->id != id) {
      return Rejected(absl::StrCat("the keypoints of ", Name(id), " moved, but it is not among the changed"));
    }
  }
  if (delta.info) CAIRN_RETURN_IF_ERROR(CheckInfo(before.info(), *delta.info, !before.keyframes().empty()));
  for (const MapCamera& camera : delta.cameras) CAIRN_RETURN_IF_ERROR(CheckCamera(camera));
  for (const Component& component : delta.components) CAIRN_RETURN_IF_ERROR(CheckComponent(component));
  for (const auto& keyframe : delta.keyframes) CAIRN_RETURN_IF_ERROR(CheckValues(before, delta, *keyframe));
  return absl::OkStatus();
}

absl::Status CheckChanged(const Snapshot& before, const Snapshot& after, const Delta& delta) {
  const TouchedPoints touched(delta);
  const bool all_new = before.keyframes().empty() && before.points().empty();
  const bool points_agree = all_new && PointsAgreeWithKeyframes(after, delta);
  for (const auto& keyframe : delta.keyframes) {
    CAIRN_RETURN_IF_ERROR(AsRejection(CheckLinks(after, *keyframe)));
    if (points_agree) continue;
    // A point that is as it was knows of an observation that is as it was.
    const Keyframe* was = before.keyframes().Find(keyframe->id);
    const bool comparable = was != nullptr && was->points.size() == keyframe->points.size();
    const auto same = [&](std::uint32_t i) {
      return comparable && was->points[i] == keyframe->points[i] && !touched.Contains(keyframe->points[i]);
    };
    CAIRN_RETURN_IF_ERROR(AsRejection(CheckObserved(after, *keyframe, same)));
    if (was != nullptr) CAIRN_RETURN_IF_ERROR(CheckDropped(after, *was, keyframe.get()));
    // Where a keyframe changed its component, its points that are as they were must be seen from there alone.
    if (was == nullptr || was->component == keyframe->component) continue;
    for (const PointId id : keyframe->points) {
      if (id && !touched.Contains(id)) CAIRN_RETURN_IF_ERROR(AsRejection(CheckPoint(after, after.point(id))));
    }
  }
  for (const auto& point : delta.points) {
    if (points_agree) break;
    CAIRN_RETURN_IF_ERROR(AsRejection(CheckPoint(after, *point)));
    const MapPoint* was = before.points().Find(point->id);
    if (was != nullptr) CAIRN_RETURN_IF_ERROR(CheckDropped(after, *was, point.get()));
  }
  for (const KeyframeId id : delta.removed_keyframes) {
    CAIRN_RETURN_IF_ERROR(CheckDropped(after, before.keyframe(id), nullptr));
  }
  for (const PointId id : delta.removed_points) CAIRN_RETURN_IF_ERROR(CheckDropped(after, before.point(id), nullptr));

  const bool heads = !delta.cameras.empty() || !delta.sessions.empty() || !delta.components.empty() ||
                     !delta.removed_cameras.empty() || !delta.removed_components.empty();
  if (heads) CAIRN_RETURN_IF_ERROR(AsRejection(CheckHeads(after)));
  if (delta.removed_cameras.empty()) return absl::OkStatus();
  absl::Status status;
  after.keyframes().ForEach([&](const auto& keyframe) {
    if (!after.cameras().contains(keyframe->camera)) {
      status.Update(Rejected(absl::StrCat(Name(keyframe->id), " was taken with ", Name(keyframe->camera))));
    }
  });
  return status;
}

absl::Status CheckHeads(const Snapshot& map) {
  for (const auto& [id, session] : map.sessions()) {
    if (!map.cameras().contains(session.camera)) return Broken(Name(id) + " has an unknown camera");
  }
  for (const ComponentId id : map.LiveComponents()) {
    if (!map.components().contains(id)) return Broken("the keyframes of " + Name(id) + " have no component");
  }
  for (const auto& [id, component] : map.components()) {
    if (!component.joined) continue;
    if (!map.components().contains(component.joined->into))
      return Broken(Name(id) + " is joined to a missing component");
    if (map.NumKeyframes(id) > 0) return Broken(Name(id) + " has been joined to another, but still has keyframes");
    if (!map.Resolve(id)) return Broken("the joins of " + Name(id) + " form a circle");
  }
  return absl::OkStatus();
}

absl::Status CheckKeyframe(const Snapshot& map, const Keyframe& keyframe) {
  CAIRN_RETURN_IF_ERROR(CheckLinks(map, keyframe));
  return CheckObserved(map, keyframe, [](std::uint32_t) { return false; });
}

absl::Status CheckPoint(const Snapshot& map, const MapPoint& point) {
  if (point.observations.empty()) return Broken(Name(point.id) + " has no observation");
  if (!point.position.allFinite()) return Broken(Name(point.id) + " has no finite position");
  ComponentId component;
  KeyframeId last;
  for (const Observation& observation : point.observations) {
    const Keyframe* keyframe = map.keyframes().Find(observation.keyframe);
    if (keyframe == nullptr || observation.feature >= keyframe->points.size() ||
        keyframe->points[observation.feature] != point.id) {
      return Broken(
          absl::StrCat(Name(point.id), " has an observation that ", Name(observation.keyframe), " does not share"));
    }
    if (!(last < observation.keyframe)) return Broken(Name(point.id) + " has observations out of order");
    last = observation.keyframe;
    if (component && keyframe->component != component) return Broken(Name(point.id) + " is seen from two components");
    component = keyframe->component;
  }
  if (!Observes(point, point.reference))
    return Broken(Name(point.id) + " refers to an observation that it does not have");
  return absl::OkStatus();
}

}  // namespace cairn::map
