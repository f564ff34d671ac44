#include "map/edit.h"

#include <algorithm>
#include <utility>

#include "map/typical_descriptor.h"
#include "map/viewing.h"

namespace cairn::map {
namespace {

void InsertSorted(std::vector<KeyframeId>& ids, KeyframeId id) {
  const auto at = std::lower_bound(ids.begin(), ids.end(), id);
  if (at == ids.end() || *at != id) ids.insert(at, id);
}

void EraseSorted(std::vector<KeyframeId>& ids, KeyframeId id) {
  const auto at = std::lower_bound(ids.begin(), ids.end(), id);
  if (at != ids.end() && *at == id) ids.erase(at);
}

// The changed or added entities in order of id, and the ids of erased ones that the base knows.
template <class Id, class T>
void Collect(const Draft<Id, T>& draft, const Table<Id, T>& base, std::vector<std::shared_ptr<const T>>* put,
             std::vector<Id>* removed) {
  draft.ForEachTouched([&](Id id, const std::shared_ptr<T>& entity) {
    if (entity) {
      put->push_back(entity);
    } else if (base.Contains(id)) {
      removed->push_back(id);
    }
  });
}

// As it is in the edit, or else in the map that it started from.
template <class Id, class T>
const T& Changed(const std::map<Id, T>& changed, const std::map<Id, T>& base, Id id) {
  const auto found = changed.find(id);
  return found != changed.end() ? found->second : base.at(id);
}

template <class Id>
Id TakeId(Id* next) {
  const Id id = *next;
  *next = Id(id.value() + 1);
  return id;
}

template <class Id, class T>
std::vector<T> Values(const std::map<Id, T>& table) {
  std::vector<T> values;
  for (const auto& [id, value] : table) values.push_back(value);
  return values;
}

}  // namespace

Edit::Edit(std::shared_ptr<const Snapshot> base)
    : base_(std::move(base)),
      keyframes_(base_->keyframes(), base_->next_keyframe()),
      points_(base_->points(), base_->next_point()),
      next_keyframe_(base_->next_keyframe()),
      next_point_(base_->next_point()),
      next_camera_(base_->next_camera()),
      next_session_(base_->next_session()),
      next_component_(base_->next_component()) {}

const MapCamera& Edit::camera(CameraId id) const { return Changed(cameras_, base_->cameras(), id); }
const Session& Edit::session(SessionId id) const { return Changed(sessions_, base_->sessions(), id); }
const Component& Edit::component(ComponentId id) const { return Changed(components_, base_->components(), id); }

CameraId Edit::AddCamera(MapCamera camera) {
  camera.id = TakeId(&next_camera_);
  PutCamera(camera);
  return camera.id;
}
void Edit::PutCamera(const MapCamera& camera) { cameras_.insert_or_assign(camera.id, camera); }

SessionId Edit::AddSession(Session session) {
  session.id = TakeId(&next_session_);
  PutSession(session);
  return session.id;
}
void Edit::PutSession(const Session& session) { sessions_.insert_or_assign(session.id, session); }

ComponentId Edit::AddComponent(Component component) {
  component.id = TakeId(&next_component_);
  PutComponent(component);
  return component.id;
}
void Edit::PutComponent(const Component& component) { components_.insert_or_assign(component.id, component); }

KeyframeId Edit::AddKeyframe(Keyframe keyframe) {
  const KeyframeId id = TakeId(&next_keyframe_);
  keyframe.id = id;
  if (!keyframe.component) {
    const auto live = base_->LiveComponents();
    if (!live.empty()) {
      keyframe.component = live.front();
    } else if (!components_.empty() || !base_->components().empty()) {
      keyframe.component = components_.empty() ? base_->components().begin()->first : components_.begin()->first;
    } else {
      keyframe.component = AddComponent({.id = {}, .session = keyframe.session});
    }
  }
  keyframe.points.assign(keyframe.features.size(), PointId());
  keyframe.parent = KeyframeId();
  keyframe.children.clear();
  keyframe.covisible.clear();
  keyframes_.Set(id, std::make_shared<Keyframe>(std::move(keyframe)));
  stale_covisibility_.insert(id);
  return id;
}

PointId Edit::AddPoint(const Vector3d& position) {
  const PointId id = TakeId(&next_point_);
  auto point = std::make_shared<MapPoint>();
  point->id = id;
  point->position = position;
  points_.Set(id, std::move(point));
  MarkStale(id, Stale::kAll);
  return id;
}

bool Edit::AddObservation(PointId point_id, KeyframeId keyframe_id, std::uint32_t feature) {
  const Keyframe& seen_by = keyframe(keyframe_id);
  if (feature >= seen_by.points.size() || seen_by.points[feature]) return false;
  const auto& known = point(point_id).observations;
  const auto at = std::lower_bound(known.begin(), known.end(), Observation{keyframe_id, 0});
  if (at != known.end() && at->keyframe == keyframe_id) return false;

  auto& observations = MutablePoint(point_id).observations;
  observations.insert(std::lower_bound(observations.begin(), observations.end(), Observation{keyframe_id, 0}),
                      Observation{keyframe_id, feature});
  MutableKeyframe(keyframe_id).points[feature] = point_id;
  stale_covisibility_.insert(keyframe_id);
  MarkStale(point_id, Stale::kAll);
  return true;
}

void Edit::RemoveObservation(PointId point_id, KeyframeId keyframe_id, int min_observations) {
  const auto& known = point(point_id).observations;
  const auto at = std::lower_bound(known.begin(), known.end(), Observation{keyframe_id, 0});
  if (at == known.end() || at->keyframe != keyframe_id) return;
  if (static_cast<int>(known.size()) - 1 < min_observations) {
    ErasePoint(point_id);
    return;
  }
  const Observation observation = *at;
  auto& observations = MutablePoint(point_id).observations;
  observations.erase(std::lower_bound(observations.begin(), observations.end(), observation));
  MutableKeyframe(keyframe_id).points[observation.feature] = PointId();
  stale_covisibility_.insert(keyframe_id);
  MarkStale(point_id, Stale::kAll);
}

void Edit::ErasePoint(PointId id) {
  for (const Observation& observation : point(id).observations) {
    MutableKeyframe(observation.keyframe).points[observation.feature] = PointId();
    stale_covisibility_.insert(observation.keyframe);
  }
  points_.Set(id, nullptr);
  points_.Mark(id) = 0;
}

bool Edit::EraseKeyframe(KeyframeId id, int min_observations) {
  // One that was added here and is not linked yet may go as well.
  const bool is_new = !base_->keyframes().Contains(id) && keyframe(id).children.empty();
  if (!keyframe(id).parent && !is_new) return false;
  const Keyframe erased = keyframe(id);
  for (const PointId point_id : erased.points) {
    if (point_id) RemoveObservation(point_id, id, min_observations);
  }
  if (erased.parent) {
    AdoptChildren(erased);
    EraseSorted(MutableKeyframe(erased.parent).children, id);
  }
  UpdateCovisibility(id);  // it shares nothing any more: this removes its edges on the other side
  stale_covisibility_.erase(id);
  keyframes_.Set(id, nullptr);
  return true;
}

void Edit::FusePoints(PointId from, PointId into) {
  if (from == into) return;
  const std::vector<Observation> moved = point(from).observations;
  const int visible = point(from).times_visible, found = point(from).times_found;
  ErasePoint(from);
  for (const Observation& observation : moved) AddObservation(into, observation.keyframe, observation.feature);
  AddVisibility(into, visible, found);
}

void Edit::SetPose(KeyframeId id, const SE3& camera_from_map) {
  MutableKeyframe(id).camera_from_map = camera_from_map;
  // Viewing directions follow the pose.
  for (const PointId point_id : keyframe(id).points) {
    if (point_id) MarkStale(point_id, Stale::kViewing);
  }
}

void Edit::SetKeypoints(KeyframeId id, std::vector<image::Keypoint> keypoints) {
  Keyframe& keyframe = MutableKeyframe(id);
  auto features = std::make_shared<KeyframeFeatures>(*keyframe.features);
  features->features.keypoints = std::move(keypoints);
  keyframe.features = std::move(features);
  moved_keypoints_.insert(id);
}

void Edit::SetPosition(PointId id, const Vector3d& position) {
  MutablePoint(id).position = position;
  MarkStale(id, Stale::kViewing);
}

void Edit::AddVisibility(PointId id, int visible, int found) {
  MapPoint& changed = MutablePoint(id);
  changed.times_visible += visible;
  changed.times_found += found;
}

void Edit::SetEdge(KeyframeId from, KeyframeId to, int shared_points) {
  const auto& known = keyframe(from).covisible;
  const auto same = std::find_if(known.begin(), known.end(), [&](const auto& edge) { return edge.keyframe == to; });
  const int before = same == known.end() ? 0 : same->shared_points;
  if (before == shared_points) return;
  auto& edges = MutableKeyframe(from).covisible;
  std::erase_if(edges, [&](const auto& edge) { return edge.keyframe == to; });
  if (shared_points == 0) return;
  const CovisibilityEdge edge{to, shared_points};
  edges.insert(std::lower_bound(edges.begin(), edges.end(), edge,
                                [](const CovisibilityEdge& a, const CovisibilityEdge& b) {
                                  return a.shared_points != b.shared_points ? a.shared_points > b.shared_points
                                                                            : a.keyframe < b.keyframe;
                                }),
               edge);
}

void Edit::UpdateCovisibility(KeyframeId id) {
  // Per keyframe by id; zero between calls.
  shared_.resize(next_keyframe_.value(), 0);
  std::vector<KeyframeId> others;
  for (const PointId point_id : keyframe(id).points) {
    if (!point_id) continue;
    for (const Observation& observation : point(point_id).observations) {
      if (observation.keyframe != id && shared_[observation.keyframe.value()]++ == 0) {
        others.push_back(observation.keyframe);
      }
    }
  }
  for (const CovisibilityEdge& edge : keyframe(id).covisible) {
    if (shared_[edge.keyframe.value()] == 0) others.push_back(edge.keyframe);
  }
  std::sort(others.begin(), others.end());
  for (const KeyframeId other : others) {
    const int count = std::exchange(shared_[other.value()], 0);
    const int kept = count >= kMinStoredSharedPoints ? count : 0;
    SetEdge(id, other, kept);
    SetEdge(other, id, kept);
  }
  stale_covisibility_.erase(id);
}

void Edit::SetParent(KeyframeId child, KeyframeId parent) {
  MutableKeyframe(child).parent = parent;
  InsertSorted(MutableKeyframe(parent).children, child);
}

// Orphans join, best covisibility first, to the erased keyframe's parent or to orphans that already joined; so the
// graph stays a tree. Who shares nothing with any of them goes to the grandparent.
void Edit::AdoptChildren(const Keyframe& orphaned) {
  std::vector<KeyframeId> orphans = orphaned.children;
  std::vector<KeyframeId> adopters = {orphaned.parent};
  while (!orphans.empty()) {
    KeyframeId best_child, best_parent;
    int best_shared = 0;
    for (const KeyframeId child : orphans) {
      for (const CovisibilityEdge& edge : keyframe(child).covisible) {
        if (edge.shared_points <= best_shared) break;
        if (std::find(adopters.begin(), adopters.end(), edge.keyframe) == adopters.end()) continue;
        best_child = child;
        best_parent = edge.keyframe;
        best_shared = edge.shared_points;
      }
    }
    if (!best_child) break;
    SetParent(best_child, best_parent);
    adopters.push_back(best_child);
    std::erase(orphans, best_child);
  }
  for (const KeyframeId child : orphans) SetParent(child, orphaned.parent);
}

// The links from it up to its root point the other way.
void Edit::MakeRoot(KeyframeId id) {
  std::vector<KeyframeId> way = {id};
  while (keyframe(way.back()).parent) way.push_back(keyframe(way.back()).parent);
  for (std::size_t i = way.size() - 1; i > 0; --i) {
    EraseSorted(MutableKeyframe(way[i]).children, way[i - 1]);
    SetParent(way[i], way[i - 1]);
  }
  MutableKeyframe(id).parent = KeyframeId();
}

std::vector<KeyframeId> Edit::KeyframesOf(ComponentId id) const {
  std::vector<KeyframeId> keyframes;
  const auto take = [&](const Keyframe* keyframe) {
    if (keyframe != nullptr && keyframe->component == id) keyframes.push_back(keyframe->id);
  };
  base_->keyframes().ForEach([&](const auto& base) { take(FindKeyframe(base->id)); });
  for (KeyframeId added = base_->next_keyframe(); added < next_keyframe_; added = KeyframeId(added.value() + 1)) {
    take(FindKeyframe(added));
  }
  return keyframes;
}

void Edit::EraseComponent(ComponentId id) {
  for (const KeyframeId keyframe_id : KeyframesOf(id)) {
    for (const PointId point : std::vector<PointId>(keyframe(keyframe_id).points)) {
      if (point && FindPoint(point) != nullptr) ErasePoint(point);
    }
    keyframes_.Set(keyframe_id, nullptr);  // what it is linked to goes as well
    stale_covisibility_.erase(keyframe_id);
  }
  const auto joined_into = [&](const auto& entry) { return entry.second.joined && entry.second.joined->into == id; };
  if (std::ranges::any_of(base_->components(), joined_into) || std::ranges::any_of(components_, joined_into)) return;
  components_.erase(id);
  if (base_->components().contains(id)) removed_components_.insert(id);
}

void Edit::JoinComponent(ComponentId joined, const ComponentJoin& join) {
  const Sim3 from_into = join.into_from_component.Inverse();
  std::set<PointId> points;
  for (const KeyframeId id : KeyframesOf(joined)) {
    SetPose(id, RigidPart(Sim3(keyframe(id).camera_from_map) * from_into));
    MutableKeyframe(id).component = join.into;
    for (const PointId point_id : keyframe(id).points) {
      if (point_id) points.insert(point_id);
    }
  }
  for (const PointId id : points) SetPosition(id, join.into_from_component * point(id).position);
  MakeRoot(join.keyframe);
  SetParent(join.keyframe, join.into_keyframe);

  Component gone = component(joined);
  gone.joined = join;
  Component into = component(join.into);
  if (gone.world_from_component && !into.world_from_component) {
    into.world_from_component = *gone.world_from_component * from_into;
    PutComponent(into);
  }
  PutComponent(gone);
}

void Edit::MarkStale(PointId id, Stale stale) {
  std::uint8_t& mark = points_.Mark(id);
  if (mark == 0) stale_points_.push_back(id);
  mark = std::max(mark, static_cast<std::uint8_t>(stale));
}

void Edit::UpdatePoint(PointId id) {
  points_.Mark(id) = 0;
  Refresh(id, Stale::kAll, nullptr);
}

// Without `centers` they are computed for this point alone.
void Edit::Refresh(PointId id, Stale stale, Centers* centers) {
  if (point(id).observations.empty()) return;
  MapPoint& changed = MutablePoint(id);
  if (stale == Stale::kAll) {
    descriptors_.clear();
    for (const Observation& observation : changed.observations) {
      descriptors_.push_back(keyframe(observation.keyframe).descriptors()[observation.feature]);
    }
    changed.reference = changed.observations[MostTypicalDescriptor(&descriptors_)];
    changed.descriptor = keyframe(changed.reference.keyframe).descriptors()[changed.reference.feature];
  }
  const auto center = [&](KeyframeId seen_by) {
    if (centers == nullptr) return keyframe(seen_by).CenterInMap();
    std::optional<Vector3d>& known = (*centers)[seen_by.value()];
    if (!known) known = keyframe(seen_by).CenterInMap();
    return *known;
  };
  seen_from_.clear();
  for (const Observation& observation : changed.observations) seen_from_.push_back(center(observation.keyframe));
  const Keyframe& reference = keyframe(changed.reference.keyframe);
  SetViewing(ComputeViewing(changed.position, seen_from_, center(reference.id),
                            reference.keypoints()[changed.reference.feature].octave, pinhole(reference.camera).fx_px,
                            info().orb),
             &changed);
}

std::vector<KeyframeId> Edit::ChangedKeyframes() const {
  std::vector<KeyframeId> ids;
  keyframes_.ForEachTouched([&](KeyframeId id, const std::shared_ptr<Keyframe>& keyframe) {
    if (keyframe) ids.push_back(id);
  });
  return ids;
}

Delta Edit::Finish(std::string reason) {
  std::vector<PointId> unseen;
  points_.ForEachTouched([&](PointId id, const std::shared_ptr<MapPoint>& point) {
    if (point && point->observations.empty() && !base_->points().Contains(id)) unseen.push_back(id);
  });
  for (const PointId id : unseen) points_.Set(id, nullptr);
  while (!stale_covisibility_.empty()) UpdateCovisibility(*stale_covisibility_.begin());
  Centers centers(next_keyframe_.value());
  for (const PointId id : stale_points_) {
    const auto stale = static_cast<Stale>(std::exchange(points_.Mark(id), std::uint8_t{0}));
    if (stale != Stale::kNo && FindPoint(id) != nullptr) Refresh(id, stale, &centers);
  }
  stale_points_.clear();
  // A new keyframe hangs below the keyframe it shares most with; a keyframe of the same edit only if it came earlier,
  // so that there is no cycle.
  for (const KeyframeId id : ChangedKeyframes()) {
    if (keyframe(id).parent || base_->keyframes().Contains(id)) continue;
    for (const CovisibilityEdge& edge : std::vector<CovisibilityEdge>(keyframe(id).covisible)) {
      if (edge.keyframe < id) {
        SetParent(id, edge.keyframe);
        break;
      }
    }
    const auto fallback = link_if_alone_.find(id);
    if (keyframe(id).parent || fallback == link_if_alone_.end()) continue;
    const Keyframe* parent = FindKeyframe(fallback->second);
    if (parent != nullptr && parent->component == keyframe(id).component) SetParent(id, parent->id);
  }

  Delta delta;
  delta.base = base_->revision();
  delta.reason = std::move(reason);
  delta.info = std::move(info_);
  delta.session = session_;
  delta.cameras = Values(cameras_);
  delta.sessions = Values(sessions_);
  delta.components = Values(components_);
  delta.removed_components.assign(removed_components_.begin(), removed_components_.end());
  for (const KeyframeId id : moved_keypoints_) {
    if (FindKeyframe(id) != nullptr) delta.moved_keypoints.push_back(id);
  }
  delta.next_keyframe = next_keyframe_;
  delta.next_point = next_point_;
  delta.next_camera = next_camera_;
  delta.next_session = next_session_;
  delta.next_component = next_component_;
  Collect(keyframes_, base_->keyframes(), &delta.keyframes, &delta.removed_keyframes);
  Collect(points_, base_->points(), &delta.points, &delta.removed_points);
  return delta;
}

}  // namespace cairn::map
