#include "care/whole_map.h"

#include <algorithm>
#include <map>
#include <utility>

#include "base/version.h"
#include "engine/session_record.h"
#include "map/camera_identity.h"
#include "map/region.h"

namespace cairn::care {
namespace {

// Ids of one map as they are in another: behind all that are there.
class Renumbering {
 public:
  explicit Renumbering(const map::Snapshot& onto)
      : keyframe_(onto.next_keyframe().value() - 1),
        point_(onto.next_point().value() - 1),
        session_(onto.next_session().value() - 1),
        component_(onto.next_component().value() - 1) {}

  KeyframeId operator()(KeyframeId id) const { return Moved(id, keyframe_); }
  PointId operator()(PointId id) const { return Moved(id, point_); }
  SessionId operator()(SessionId id) const { return Moved(id, session_); }
  ComponentId operator()(ComponentId id) const { return Moved(id, component_); }
  CameraId operator()(CameraId id) const { return id ? cameras.at(id) : id; }

  std::map<CameraId, CameraId> cameras;

 private:
  template <class Id>
  static Id Moved(Id id, typename Id::Value by) {
    return id ? Id(id.value() + by) : id;
  }
  KeyframeId::Value keyframe_;
  PointId::Value point_;
  SessionId::Value session_;
  ComponentId::Value component_;
};

map::Session Renumbered(map::Session session, const Renumbering& to) {
  session.id = to(session.id);
  session.camera = to(session.camera);
  for (ComponentId& id : session.components) id = to(id);
  for (map::ClosedLoop& loop : session.loops) {
    loop.keyframe = to(loop.keyframe);
    loop.loop_keyframe = to(loop.loop_keyframe);
  }
  return session;
}

map::Component Renumbered(map::Component component, const Renumbering& to) {
  component.id = to(component.id);
  component.session = to(component.session);
  if (component.joined) {
    component.joined->into = to(component.joined->into);
    component.joined->keyframe = to(component.joined->keyframe);
    component.joined->into_keyframe = to(component.joined->into_keyframe);
  }
  return component;
}

std::shared_ptr<map::Keyframe> Renumbered(const map::Keyframe& from, const Renumbering& to) {
  auto keyframe = std::make_shared<map::Keyframe>(from);
  keyframe->id = to(from.id);
  keyframe->session = to(from.session);
  keyframe->camera = to(from.camera);
  keyframe->component = to(from.component);
  keyframe->parent = to(from.parent);
  for (PointId& point : keyframe->points) point = to(point);
  for (KeyframeId& child : keyframe->children) child = to(child);
  for (map::CovisibilityEdge& edge : keyframe->covisible) edge.keyframe = to(edge.keyframe);
  return keyframe;
}

std::shared_ptr<map::MapPoint> Renumbered(const map::MapPoint& from, const Renumbering& to) {
  auto point = std::make_shared<map::MapPoint>(from);
  point->id = to(from.id);
  for (map::Observation& observation : point->observations) observation.keyframe = to(observation.keyframe);
  point->reference.keyframe = to(from.reference.keyframe);
  return point;
}

// The words of another vocabulary mean nothing here.
std::shared_ptr<const map::KeyframeFeatures> WithWords(const map::KeyframeFeatures& from,
                                                       const place::Vocabulary& words) {
  auto features = std::make_shared<map::KeyframeFeatures>(from);
  features->words = words.LookupAll(from.features.descriptors);
  return features;
}

bool HasName(const map::Snapshot& onto, const std::vector<map::MapCamera>& added, const std::string& name) {
  return std::ranges::any_of(onto.cameras(), [&](const auto& entry) { return entry.second.name == name; }) ||
         std::ranges::any_of(added, [&](const map::MapCamera& camera) { return camera.name == name; });
}

// A camera that both maps have is one.
void MergeCameras(const map::Snapshot& onto, const map::Snapshot& from, Renumbering* to, map::Delta* delta) {
  for (const auto& entry_of_from : from.cameras()) {
    const CameraId id = entry_of_from.first;
    const map::MapCamera& camera = entry_of_from.second;
    const auto same = std::ranges::find_if(onto.cameras(), [&](const auto& entry) {
      const map::MapCamera& known = entry.second;
      return map::SameCalibration(known.model, camera.model) && map::SamePinhole(known.pinhole, camera.pinhole) &&
             known.lens == camera.lens;
    });
    if (same != onto.cameras().end()) {
      to->cameras[id] = same->first;
      continue;
    }
    map::MapCamera added = camera;
    added.id = delta->next_camera;
    for (int number = 2; HasName(onto, delta->cameras, added.name); ++number) {
      added.name = absl::StrCat(camera.name, " (", number, ")");
    }
    to->cameras[id] = added.id;
    delta->next_camera = CameraId(delta->next_camera.value() + 1);
    delta->cameras.push_back(std::move(added));
  }
}

}  // namespace

map::Delta AsOneChange(const map::Snapshot& map, const std::string& reason) {
  map::Delta delta = map::AllOf(map);
  delta.base = 0;
  delta.reason = reason;
  // What was joined in another history is so from the first revision of this one.
  for (map::Component& component : delta.components) {
    if (component.joined) component.joined->revision = 1;
  }
  return delta;
}

absl::StatusOr<map::Delta> Beside(const map::Snapshot& onto, const map::Snapshot& from, const place::Vocabulary* words,
                                  const std::string& reason) {
  if (!(onto.info().orb == from.info().orb)) {
    return absl::FailedPreconditionError(
        "the two maps were made with other ORB parameters, so that their features cannot be compared");
  }
  const bool other_words = onto.info().vocabulary_hash != from.info().vocabulary_hash;
  if (other_words && words == nullptr) {
    return absl::FailedPreconditionError(
        "the two maps have different vocabularies, and none that the second could be looked up in");
  }
  map::Delta delta;
  delta.base = onto.revision();
  delta.reason = reason;
  delta.next_camera = onto.next_camera();
  Renumbering to(onto);
  MergeCameras(onto, from, &to, &delta);
  for (const auto& [id, session] : from.sessions()) delta.sessions.push_back(Renumbered(session, to));
  for (const auto& [id, component] : from.components()) delta.components.push_back(Renumbered(component, to));
  from.keyframes().ForEach([&](const auto& keyframe) {
    auto added = Renumbered(*keyframe, to);
    if (other_words) added->features = WithWords(*keyframe->features, *words);
    delta.keyframes.push_back(std::move(added));
  });
  from.points().ForEach([&](const auto& point) { delta.points.push_back(Renumbered(*point, to)); });
  delta.next_keyframe = to(from.next_keyframe());
  delta.next_point = to(from.next_point());
  delta.next_session = to(from.next_session());
  delta.next_component = to(from.next_component());
  return delta;
}

map::MapInfo NewMapInfo(const map::MapInfo& like, const std::string& name) {
  map::MapInfo info = like;
  info.id = engine::NewMapId(std::nullopt);
  info.name = name;
  info.software_version = kVersion;
  info.created_unix_ns = engine::UnixNowNs();
  return info;
}

absl::StatusOr<std::unique_ptr<store::MapStore>> PrepareNewMap(const map::Snapshot& map, const map::MapInfo& info,
                                                               const std::string& vocabulary, const std::string& uri,
                                                               bool overwrite, const std::string& reason,
                                                               const store::WriteOptions& write) {
  store::CreateOptions options;
  options.write = write;
  options.overwrite = overwrite;
  options.whole = true;
  options.vocabulary = vocabulary;
  CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<store::MapStore> store, store::CreateMapStore(uri, info, options));
  const map::Delta delta = AsOneChange(map, reason);
  CAIRN_RETURN_IF_ERROR(map::Snapshot::Empty(info)->Apply(delta).status());
  CAIRN_RETURN_IF_ERROR(store->Commit(delta));
  return store;
}

absl::Status WriteNewMap(const map::Snapshot& map, const map::MapInfo& info, const std::string& vocabulary,
                         const std::string& uri, bool overwrite, const std::string& reason,
                         const store::WriteOptions& write) {
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<store::MapStore> store,
                         PrepareNewMap(map, info, vocabulary, uri, overwrite, reason, write));
  return store->Close();
}

}  // namespace cairn::care
