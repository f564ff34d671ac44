#include "map/snapshot.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

namespace cairn::map {
namespace {

absl::Status Broken(const std::string& what) {
  return absl::DataLossError(absl::StrCat("the map is inconsistent: ", what));
}

std::string Name(KeyframeId id) { return absl::StrCat("keyframe ", id.value()); }
std::string Name(PointId id) { return absl::StrCat("point ", id.value()); }

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

// same(i) tells which features need no look.
template <class Same>
absl::Status CheckKeyframe(const Snapshot& map, const Keyframe& keyframe, Same same) {
  if (!map.cameras().contains(keyframe.camera)) return Broken(Name(keyframe.id) + " has an unknown camera");
  if (!map.sessions().contains(keyframe.session)) return Broken(Name(keyframe.id) + " has an unknown session");
  if (!keyframe.features || keyframe.points.size() != keyframe.features->features.size()) {
    return Broken(Name(keyframe.id) + " does not have one point entry per feature");
  }
  for (std::uint32_t i = 0; i < keyframe.points.size(); ++i) {
    if (!keyframe.points[i] || same(i)) continue;
    const MapPoint* point = map.points().Find(keyframe.points[i]);
    if (point == nullptr)
      return Broken(absl::StrCat(Name(keyframe.id), " observes missing ", Name(keyframe.points[i])));
    const Observation observation{keyframe.id, i};
    if (!std::binary_search(point->observations.begin(), point->observations.end(), observation)) {
      return Broken(absl::StrCat(Name(point->id), " does not know that ", Name(keyframe.id), " observes it"));
    }
  }
  if (keyframe.parent) {
    const Keyframe* parent = map.keyframes().Find(keyframe.parent);
    if (parent == nullptr) return Broken(Name(keyframe.id) + " has a missing parent");
    if (!std::binary_search(parent->children.begin(), parent->children.end(), keyframe.id)) {
      return Broken(Name(parent->id) + " does not list its child " + Name(keyframe.id));
    }
  }
  for (const KeyframeId child : keyframe.children) {
    const Keyframe* found = map.keyframes().Find(child);
    if (found == nullptr || found->parent != keyframe.id) return Broken(Name(keyframe.id) + " lists a wrong child");
  }
  for (const CovisibilityEdge& edge : keyframe.covisible) {
    const Keyframe* other = map.keyframes().Find(edge.keyframe);
    const CovisibilityEdge back{keyframe.id, edge.shared_points};
    if (other == nullptr ||
        std::find(other->covisible.begin(), other->covisible.end(), back) == other->covisible.end()) {
      return Broken(
          absl::StrCat("the covisibility of ", Name(keyframe.id), " and ", Name(edge.keyframe), " is not symmetric"));
    }
  }
  return absl::OkStatus();
}

absl::Status CheckPoint(const Snapshot& map, const MapPoint& point) {
  if (point.observations.empty()) return Broken(Name(point.id) + " has no observation");
  if (!point.position.allFinite()) return Broken(Name(point.id) + " has no finite position");
  for (const Observation& observation : point.observations) {
    const Keyframe* keyframe = map.keyframes().Find(observation.keyframe);
    if (keyframe == nullptr || observation.feature >= keyframe->points.size() ||
        keyframe->points[observation.feature] != point.id) {
      return Broken(
          absl::StrCat(Name(point.id), " has an observation that ", Name(observation.keyframe), " does not share"));
    }
  }
  if (!std::binary_search(point.observations.begin(), point.observations.end(), point.reference)) {
    return Broken(Name(point.id) + " refers to an observation that it does not have");
  }
  return absl::OkStatus();
}

}  // namespace

std::shared_ptr<const Snapshot> Snapshot::Empty(MapInfo info, Revision revision) {
  auto snapshot = std::make_shared<Snapshot>();
  snapshot->revision_ = revision;
  snapshot->info_ = std::make_shared<const MapInfo>(std::move(info));
  snapshot->cameras_ = std::make_shared<const std::map<CameraId, MapCamera>>();
  snapshot->sessions_ = std::make_shared<const std::map<SessionId, Session>>();
  return snapshot;
}

absl::StatusOr<std::shared_ptr<const Snapshot>> Snapshot::Apply(const Delta& delta) const {
  if (delta.base != revision_) {
    return absl::FailedPreconditionError(
        absl::StrCat("the change starts from revision ", delta.base, " but the map is at revision ", revision_));
  }
  auto next = std::make_shared<Snapshot>(*this);
  next->revision_ = delta.revision();
  next->next_keyframe_ = std::max(next_keyframe_, delta.next_keyframe);
  next->next_point_ = std::max(next_point_, delta.next_point);
  if (delta.info) next->info_ = std::make_shared<const MapInfo>(*delta.info);
  if (!delta.cameras.empty()) {
    auto cameras = std::make_shared<std::map<CameraId, MapCamera>>(*cameras_);
    for (const MapCamera& camera : delta.cameras) cameras->insert_or_assign(camera.id, camera);
    next->cameras_ = std::move(cameras);
  }
  if (!delta.sessions.empty()) {
    auto sessions = std::make_shared<std::map<SessionId, Session>>(*sessions_);
    for (const Session& session : delta.sessions) sessions->insert_or_assign(session.id, session);
    next->sessions_ = std::move(sessions);
  }

  const TableEdit edit;
  for (const PointId id : delta.removed_points) {
    if (!points_.Contains(id)) return absl::InvalidArgumentError("the change removes missing " + Name(id));
    next->points_.Set(id, nullptr, edit);
  }
  for (const KeyframeId id : delta.removed_keyframes) {
    if (!keyframes_.Contains(id)) return absl::InvalidArgumentError("the change removes missing " + Name(id));
    next->keyframes_.Set(id, nullptr, edit);
  }
  for (const auto& keyframe : delta.keyframes) {
    if (!keyframe || !keyframe->id || !(keyframe->id < next->next_keyframe_)) {
      return absl::InvalidArgumentError("the change holds a keyframe without a valid id");
    }
    next->keyframes_.Set(keyframe->id, keyframe, edit);
  }
  for (const auto& point : delta.points) {
    if (!point || !point->id || !(point->id < next->next_point_)) {
      return absl::InvalidArgumentError("the change holds a point without a valid id");
    }
    next->points_.Set(point->id, point, edit);
  }
  // What was put must resolve; what was removed was unlinked by whoever made the delta.
  const TouchedPoints touched(delta);
  for (const auto& keyframe : delta.keyframes) {
    // A point that is as it was knows of an observation that is as it was.
    const Keyframe* before = keyframes_.Find(keyframe->id);
    const bool comparable = before != nullptr && before->points.size() == keyframe->points.size();
    const auto same = [&](std::uint32_t i) {
      return comparable && before->points[i] == keyframe->points[i] && !touched.Contains(keyframe->points[i]);
    };
    if (absl::Status status = CheckKeyframe(*next, *keyframe, same); !status.ok()) {
      return absl::InvalidArgumentError(absl::StrCat("change rejected: ", status.message()));
    }
  }
  for (const auto& point : delta.points) {
    if (absl::Status status = CheckPoint(*next, *point); !status.ok()) {
      return absl::InvalidArgumentError(absl::StrCat("change rejected: ", status.message()));
    }
  }
  return next;
}

absl::Status Snapshot::CheckConsistency() const {
  absl::Status status;
  keyframes_.ForEach([&](const auto& keyframe) {
    if (status.ok()) status = CheckKeyframe(*this, *keyframe, [](std::uint32_t) { return false; });
  });
  points_.ForEach([&](const auto& point) {
    if (status.ok()) status = CheckPoint(*this, *point);
  });
  return status;
}

std::vector<KeyframeId> BestCovisible(const Keyframe& keyframe, int max_count, int min_shared) {
  std::vector<KeyframeId> best;
  for (const CovisibilityEdge& edge : keyframe.covisible) {
    if (max_count > 0 && static_cast<int>(best.size()) >= max_count) break;
    if (edge.shared_points < min_shared && !best.empty()) break;
    best.push_back(edge.keyframe);
    if (edge.shared_points < min_shared) break;  // the best there is
  }
  return best;
}

}  // namespace cairn::map
