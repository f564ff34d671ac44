#include "care/selection.h"

#include <map>
#include <set>
#include <vector>

#include "care/whole_map.h"
#include "map/edit.h"

namespace cairn::care {
namespace {

struct Sides {
  std::vector<KeyframeId> dropped;
  KeyframeId oldest_kept;
};

// Drops the keyframes; of points, those that nobody is left to see.
void DropOthers(const std::function<bool(const map::Keyframe&)>& keep, map::Edit* edit) {
  std::map<ComponentId, Sides> components;
  edit->base().keyframes().ForEach([&](const auto& keyframe) {
    Sides& sides = components[keyframe->component];
    if (!keep(*keyframe)) {
      sides.dropped.push_back(keyframe->id);
    } else if (!sides.oldest_kept) {
      sides.oldest_kept = keyframe->id;
    }
  });
  for (const auto& [component, sides] : components) {
    if (!sides.oldest_kept) {
      edit->EraseComponent(component);
      continue;
    }
    bool root_goes = false;
    for (const KeyframeId id : sides.dropped) root_goes |= !edit->keyframe(id).parent;
    if (root_goes) edit->MakeRoot(sides.oldest_kept);
    for (const KeyframeId id : sides.dropped) edit->EraseKeyframe(id, 1);
  }
}

// Components without keyframes, and the history of joins of which a side is no longer there. One whose beginner has
// left counts as begun by the first session that is still in it.
void DropComponents(const std::map<ComponentId, std::set<SessionId>>& present, const std::set<SessionId>& sessions,
                    map::Delta* delta) {
  std::set<ComponentId> kept;
  for (const map::Component& component : delta->components) {
    if (sessions.contains(component.session) && (component.joined || present.contains(component.id))) {
      kept.insert(component.id);
    }
  }
  for (std::size_t before = 0; before != kept.size();) {
    before = kept.size();
    for (const map::Component& component : delta->components) {
      if (component.joined && !kept.contains(component.joined->into)) kept.erase(component.id);
    }
  }
  for (const auto& [id, in_it] : present) kept.insert(id);
  std::erase_if(delta->components, [&](const map::Component& component) { return !kept.contains(component.id); });
  for (map::Component& component : delta->components) {
    const auto in_it = present.find(component.id);
    if (in_it != present.end() && !sessions.contains(component.session)) component.session = *in_it->second.begin();
  }
}

// Rows that nothing that is left refers to.
void DropUnused(map::Delta* delta) {
  std::map<ComponentId, std::set<SessionId>> present;  // that have keyframes there
  std::set<SessionId> sessions;
  std::set<CameraId> cameras;
  for (const auto& keyframe : delta->keyframes) {
    present[keyframe->component].insert(keyframe->session);
    sessions.insert(keyframe->session);
    cameras.insert(keyframe->camera);
  }
  DropComponents(present, sessions, delta);
  std::set<ComponentId> components;
  for (const map::Component& component : delta->components) components.insert(component.id);
  std::erase_if(delta->sessions, [&](const map::Session& session) { return !sessions.contains(session.id); });
  for (map::Session& session : delta->sessions) {
    std::erase_if(session.components, [&](ComponentId id) { return !components.contains(id); });
    cameras.insert(session.camera);
  }
  std::erase_if(delta->cameras, [&](const map::MapCamera& camera) { return !cameras.contains(camera.id); });
}

}  // namespace

absl::StatusOr<std::shared_ptr<const map::Snapshot>> SelectKeyframes(
    const map::Snapshot& map, const map::MapInfo& info, const std::function<bool(const map::Keyframe&)>& keep) {
  // An edit of a map without history: its revisions do not matter here.
  CAIRN_ASSIGN_OR_RETURN(const auto start, map::Snapshot::Empty(map.info())->Apply(AsOneChange(map, "select")));
  map::Edit edit(start);
  DropOthers(keep, &edit);
  CAIRN_ASSIGN_OR_RETURN(const auto part, start->Apply(edit.Finish("select")));
  if (part->keyframes().empty()) return absl::FailedPreconditionError("no keyframe is in that part of the map");
  map::Delta delta = AsOneChange(*part, "select");
  DropUnused(&delta);
  return map::Snapshot::Empty(info)->Apply(delta);
}

}  // namespace cairn::care
