#include "map/edit.h"

#include <algorithm>
#include <array>
#include <utility>

#include "image/hamming.h"
#include "map/viewing.h"

namespace cairn::map {
namespace {

constexpr std::size_t kMostCompared = 24;

// The one with the least median distance to the others. Beyond kMostCompared an even sample stands for all: the choice
// is quadratic. Leaves the sample in `descriptors`.
std::size_t MostTypical(std::vector<image::Descriptor>* descriptors) {
  const std::size_t step = (descriptors->size() + kMostCompared - 1) / kMostCompared;
  std::size_t count = 0;
  for (std::size_t i = 0; i < descriptors->size(); i += step) (*descriptors)[count++] = (*descriptors)[i];
  if (count == 1) return 0;
  std::size_t best = 0;
  int best_median = 257;
  std::array<std::uint16_t, kMostCompared> distances;
  for (std::size_t i = 0; i < count; ++i) {
    image::HammingDistances((*descriptors)[i], descriptors->data(), count, distances.data());
    distances[i] = distances[count - 1];  // not to itself
    const auto middle = distances.begin() + (count - 1) / 2;
    std::nth_element(distances.begin(), middle, distances.begin() + (count - 1));
    if (*middle < best_median) {
      best_median = *middle;
      best = i;
    }
  }
  return best * step;
}

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

}  // namespace

Edit::Edit(std::shared_ptr<const Snapshot> base)
    : base_(std::move(base)),
      keyframes_(base_->keyframes(), base_->next_keyframe()),
      points_(base_->points(), base_->next_point()),
      next_keyframe_(base_->next_keyframe()),
      next_point_(base_->next_point()) {}

const MapCamera& Edit::camera(CameraId id) const {
  for (const MapCamera& camera : cameras_) {
    if (camera.id == id) return camera;
  }
  return base_->cameras().at(id);
}

CameraId Edit::AddCamera(MapCamera camera) {
  const auto added = std::count_if(cameras_.begin(), cameras_.end(),
                                   [&](const MapCamera& other) { return !base_->cameras().contains(other.id); });
  camera.id = CameraId(static_cast<CameraId::Value>(base_->cameras().size() + static_cast<std::size_t>(added) + 1));
  cameras_.push_back(std::move(camera));
  return cameras_.back().id;
}

void Edit::PutCamera(const MapCamera& camera) {
  const auto known =
      std::find_if(cameras_.begin(), cameras_.end(), [&](const MapCamera& other) { return other.id == camera.id; });
  if (known != cameras_.end()) {
    *known = camera;
  } else {
    cameras_.push_back(camera);
  }
}

SessionId Edit::AddSession(Session session) {
  session.id = SessionId(static_cast<SessionId::Value>(base_->sessions().size() + sessions_.size() + 1));
  sessions_.push_back(std::move(session));
  return sessions_.back().id;
}

void Edit::PutSession(const Session& session) {
  for (Session& known : sessions_) {
    if (known.id == session.id) {
      known = session;
      return;
    }
  }
  sessions_.push_back(session);
}

KeyframeId Edit::AddKeyframe(Keyframe keyframe) {
  const KeyframeId id = next_keyframe_;
  next_keyframe_ = KeyframeId(id.value() + 1);
  keyframe.id = id;
  keyframe.points.assign(keyframe.features->features.size(), PointId());
  keyframe.parent = KeyframeId();
  keyframe.children.clear();
  keyframe.covisible.clear();
  keyframes_.Set(id, std::make_shared<Keyframe>(std::move(keyframe)));
  stale_covisibility_.insert(id);
  return id;
}

PointId Edit::AddPoint(const Vector3d& position) {
  const PointId id = next_point_;
  next_point_ = PointId(id.value() + 1);
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
    changed.reference = changed.observations[MostTypical(&descriptors_)];
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
  const int octave = keyframe(changed.reference.keyframe).keypoints()[changed.reference.feature].octave;
  SetViewing(ComputeViewing(changed.position, seen_from_, center(changed.reference.keyframe), octave, info().orb),
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
    if (!keyframe(id).parent && fallback != link_if_alone_.end() && FindKeyframe(fallback->second) != nullptr) {
      SetParent(id, fallback->second);
    }
  }

  Delta delta;
  delta.base = base_->revision();
  delta.reason = std::move(reason);
  delta.info = std::move(info_);
  delta.cameras = std::move(cameras_);
  for (const KeyframeId id : moved_keypoints_) {
    if (FindKeyframe(id) != nullptr) delta.moved_keypoints.push_back(id);
  }
  delta.sessions = std::move(sessions_);
  delta.next_keyframe = next_keyframe_;
  delta.next_point = next_point_;
  Collect(keyframes_, base_->keyframes(), &delta.keyframes, &delta.removed_keyframes);
  Collect(points_, base_->points(), &delta.points, &delta.removed_points);
  return delta;
}

}  // namespace cairn::map
