#include "map/delta.h"

#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "map/delta_ids.h"
#include "map/snapshot.h"

namespace cairn::map {
namespace {

// What two changes of one table put and remove together; `known` tells what was there before both.
template <class T, class IdType, class Known>
void Merge(const std::vector<T>& first, const std::vector<IdType>& first_removed, const std::vector<T>& second,
           const std::vector<IdType>& second_removed, Known known, std::vector<T>* put, std::vector<IdType>* removed) {
  std::map<IdType, const T*> last;  // null: removed
  for (const IdType id : first_removed) last[id] = nullptr;
  for (const T& value : first) last[IdOf(value)] = &value;
  for (const IdType id : second_removed) last[id] = nullptr;
  for (const T& value : second) last[IdOf(value)] = &value;
  for (const auto& [id, value] : last) {
    if (value != nullptr) {
      put->push_back(*value);
    } else if (known(id)) {
      removed->push_back(id);
    }
  }
}

}  // namespace

absl::StatusOr<Delta> MergeDeltas(const Snapshot& base, const Delta& first, const Delta& second) {
  if (first.base != base.revision() || second.base != first.revision()) {
    return absl::InvalidArgumentError(absl::StrCat("merging changes: one from revision ", first.base, " to ",
                                                   first.revision(), " and one from ", second.base,
                                                   " do not follow each other from revision ", base.revision()));
  }
  Delta merged;
  merged.base = first.base;
  merged.num_changes = first.num_changes + second.num_changes;
  merged.reason = absl::StrCat(merged.num_changes, " changes");
  if (first.session == second.session) merged.session = first.session;
  merged.info = second.info ? second.info : first.info;
  std::vector<SessionId> none;
  Merge(
      first.cameras, first.removed_cameras, second.cameras, second.removed_cameras,
      [&](CameraId id) { return base.cameras().contains(id); }, &merged.cameras, &merged.removed_cameras);
  Merge(
      first.sessions, {}, second.sessions, {}, [](SessionId) { return false; }, &merged.sessions, &none);
  Merge(
      first.components, first.removed_components, second.components, second.removed_components,
      [&](ComponentId id) { return base.components().contains(id); }, &merged.components, &merged.removed_components);
  Merge(
      first.keyframes, first.removed_keyframes, second.keyframes, second.removed_keyframes,
      [&](KeyframeId id) { return base.keyframes().Contains(id); }, &merged.keyframes, &merged.removed_keyframes);
  Merge(
      first.points, first.removed_points, second.points, second.removed_points,
      [&](PointId id) { return base.points().Contains(id); }, &merged.points, &merged.removed_points);
  std::set<KeyframeId> moved(first.moved_keypoints.begin(), first.moved_keypoints.end());
  moved.insert(second.moved_keypoints.begin(), second.moved_keypoints.end());
  for (const auto& keyframe : merged.keyframes) {
    if (moved.contains(keyframe->id) && base.keyframes().Contains(keyframe->id)) {
      merged.moved_keypoints.push_back(keyframe->id);
    }
  }
  merged.next_keyframe = std::max(first.next_keyframe, second.next_keyframe);
  merged.next_point = std::max(first.next_point, second.next_point);
  merged.next_camera = std::max(first.next_camera, second.next_camera);
  merged.next_session = std::max(first.next_session, second.next_session);
  merged.next_component = std::max(first.next_component, second.next_component);
  return merged;
}

}  // namespace cairn::map
