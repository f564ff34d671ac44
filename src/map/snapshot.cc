#include "map/snapshot.h"

#include <algorithm>
#include <utility>
#include <vector>

#include "map/delta_check.h"

namespace cairn::map {
namespace {

template <class T>
std::shared_ptr<const T> Share(T value = {}) {
  return std::make_shared<const T>(std::move(value));
}

// `table` with what was removed gone and what was put there; the same one if nothing was.
template <class IdType, class T>
std::shared_ptr<const std::map<IdType, T>> Updated(const std::shared_ptr<const std::map<IdType, T>>& table,
                                                   const std::vector<T>& put, const std::vector<IdType>& removed = {}) {
  if (put.empty() && removed.empty()) return table;
  auto updated = std::make_shared<std::map<IdType, T>>(*table);
  for (const IdType id : removed) updated->erase(id);
  for (const T& value : put) updated->insert_or_assign(value.id, value);
  return updated;
}

// Keyframes per component after the change; the same table if no count changes.
using Counts = std::map<ComponentId, std::int64_t>;
std::shared_ptr<const Counts> Recounted(const std::shared_ptr<const Counts>& counts,
                                        const Table<KeyframeId, Keyframe>& before, const Delta& delta) {
  Counts change;
  for (const KeyframeId id : delta.removed_keyframes) {
    if (const Keyframe* was = before.Find(id)) --change[was->component];
  }
  for (const auto& keyframe : delta.keyframes) {
    const Keyframe* was = before.Find(keyframe->id);
    if (was != nullptr && was->component == keyframe->component) continue;
    if (was != nullptr) --change[was->component];
    ++change[keyframe->component];
  }
  std::erase_if(change, [](const auto& entry) { return entry.second == 0; });
  if (change.empty()) return counts;
  auto updated = std::make_shared<Counts>(*counts);
  for (const auto& [id, difference] : change) {
    if (((*updated)[id] += difference) == 0) updated->erase(id);
  }
  return updated;
}

template <class T>
auto ById(std::vector<T> values) {
  using IdType = decltype(T::id);
  auto table = std::make_shared<std::map<IdType, T>>();
  for (T& value : values) table->emplace_hint(table->end(), value.id, std::move(value));
  return std::shared_ptr<const std::map<IdType, T>>(std::move(table));
}

}  // namespace

std::shared_ptr<const Snapshot> Snapshot::Of(SnapshotParts parts) {
  auto snapshot = std::make_shared<Snapshot>();
  snapshot->revision_ = parts.revision;
  snapshot->info_ = Share<MapInfo>(std::move(parts.info));
  snapshot->cameras_ = ById(std::move(parts.cameras));
  snapshot->sessions_ = ById(std::move(parts.sessions));
  snapshot->components_ = ById(std::move(parts.components));
  snapshot->num_keyframes_ = Share<Counts>(std::move(parts.num_keyframes));
  snapshot->keyframes_ = Table<KeyframeId, Keyframe>::Over(parts.entities->keyframes());
  snapshot->points_ = Table<PointId, MapPoint>::Over(parts.entities->points());
  snapshot->entities_ = std::move(parts.entities);
  snapshot->feature_cache_ = std::move(parts.feature_cache);
  snapshot->next_keyframe_ = parts.next_keyframe;
  snapshot->next_point_ = parts.next_point;
  snapshot->next_camera_ = parts.next_camera;
  snapshot->next_session_ = parts.next_session;
  snapshot->next_component_ = parts.next_component;
  return snapshot;
}

std::shared_ptr<const Snapshot> Snapshot::Empty(MapInfo info, Revision revision) {
  auto snapshot = std::make_shared<Snapshot>();
  snapshot->revision_ = revision;
  snapshot->info_ = Share<MapInfo>(std::move(info));
  snapshot->cameras_ = Share<std::map<CameraId, MapCamera>>();
  snapshot->sessions_ = Share<std::map<SessionId, Session>>();
  snapshot->components_ = Share<std::map<ComponentId, Component>>();
  snapshot->num_keyframes_ = Share<Counts>();
  return snapshot;
}

absl::StatusOr<std::shared_ptr<const Snapshot>> Snapshot::Apply(const Delta& delta) const {
  if (delta.base != revision_) {
    return absl::FailedPreconditionError(
        absl::StrCat("the change starts from revision ", delta.base, " but the map is at revision ", revision_));
  }
  CAIRN_RETURN_IF_ERROR(CheckDelta(*this, delta));
  auto next = std::make_shared<Snapshot>(*this);
  next->revision_ = delta.revision();
  next->next_keyframe_ = std::max(next_keyframe_, delta.next_keyframe);
  next->next_point_ = std::max(next_point_, delta.next_point);
  next->next_camera_ = std::max(next_camera_, delta.next_camera);
  next->next_session_ = std::max(next_session_, delta.next_session);
  next->next_component_ = std::max(next_component_, delta.next_component);
  if (delta.info) next->info_ = Share<MapInfo>(*delta.info);
  next->cameras_ = Updated(cameras_, delta.cameras, delta.removed_cameras);
  next->sessions_ = Updated(sessions_, delta.sessions);
  next->components_ = Updated(components_, delta.components, delta.removed_components);
  next->num_keyframes_ = Recounted(num_keyframes_, keyframes_, delta);

  const TableEdit edit;
  for (const PointId id : delta.removed_points) next->points_.Set(id, nullptr, edit);
  for (const KeyframeId id : delta.removed_keyframes) next->keyframes_.Set(id, nullptr, edit);
  for (const auto& keyframe : delta.keyframes) next->keyframes_.Set(keyframe->id, keyframe, edit);
  for (const auto& point : delta.points) next->points_.Set(point->id, point, edit);
  CAIRN_RETURN_IF_ERROR(CheckChanged(*this, *next, delta));
  return next;
}

std::shared_ptr<const Snapshot> Snapshot::With(std::shared_ptr<FeatureCache> cache) const {
  auto same = std::make_shared<Snapshot>(*this);
  same->feature_cache_ = std::move(cache);
  return same;
}

std::shared_ptr<const Snapshot> Snapshot::Anew() const {
  auto same = std::make_shared<Snapshot>(*this);
  if (entities_ == nullptr) return same;
  same->entities_ = entities_->Anew();
  same->keyframes_ = keyframes_.WithSource(same->entities_->keyframes());
  same->points_ = points_.WithSource(same->entities_->points());
  return same;
}

std::int64_t Snapshot::NumKeyframes(ComponentId id) const {
  const auto found = num_keyframes_->find(id);
  return found == num_keyframes_->end() ? 0 : found->second;
}

std::vector<ComponentId> Snapshot::LiveComponents() const {
  std::vector<ComponentId> live;
  for (const auto& [id, count] : *num_keyframes_) live.push_back(id);
  return live;
}

ComponentId Snapshot::Resolve(ComponentId id) const {
  // As many steps as there are components, lest joins form a circle.
  for (std::size_t i = 0; i <= components_->size(); ++i) {
    const auto found = components_->find(id);
    if (found == components_->end()) return ComponentId();
    if (!found->second.joined) return id;
    id = found->second.joined->into;
  }
  return ComponentId();
}

absl::Status Snapshot::CheckConsistency() const {
  absl::Status status = CheckHeads(*this);
  keyframes_.ForEach([&](const auto& keyframe) {
    if (status.ok()) status = CheckKeyframe(*this, *keyframe);
  });
  points_.ForEach([&](const auto& point) {
    if (status.ok()) status = CheckPoint(*this, *point);
  });
  return status;
}

void ForEachKeyframe(const Snapshot& map, std::size_t budget_bytes,
                     const std::function<void(const Snapshot& map, const Keyframe& keyframe)>& visit) {
  if (map.entities() == nullptr) {
    map.keyframes().ForEach([&](const std::shared_ptr<const Keyframe>& keyframe) { visit(map, *keyframe); });
    return;
  }
  std::shared_ptr<const Snapshot> around = map.Anew();
  for (KeyframeId id(1); id < map.next_keyframe(); id = KeyframeId(id.value() + 1)) {
    if (around->entities()->bytes() > budget_bytes) around = map.Anew();
    if (const Keyframe* keyframe = around->keyframes().Find(id)) visit(*around, *keyframe);
  }
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
