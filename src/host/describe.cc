#include "host/describe.h"

#include <algorithm>
#include <map>
#include <utility>

namespace cairn::host {

namespace {

// By session, of those that are running or were cut off: their end is not written down.
std::map<SessionId, TimeNs> NewestKeyframes(const map::Snapshot& map) {
  std::map<SessionId, TimeNs> newest;
  for (const auto& [id, session] : map.sessions()) {
    if (!session.complete) newest.emplace(id, session.first_ns);
  }
  if (newest.empty()) return newest;
  map.keyframes().ForEach([&](const auto& keyframe) {
    const auto of = newest.find(keyframe->session);
    if (of != newest.end()) of->second = std::max(of->second, keyframe->time_ns);
  });
  return newest;
}

}  // namespace

api::MapSummary SummaryOf(const std::string& name, const store::MapSummary& stored) {
  api::MapSummary summary;
  summary.name = name;
  summary.id = stored.info.id;
  summary.title = stored.info.name;
  summary.revision = stored.revision;
  summary.format_version = stored.format_version;
  summary.keyframes = stored.keyframes;
  summary.points = stored.points;
  summary.cameras = stored.cameras;
  summary.components = stored.components;
  summary.sessions = stored.sessions;
  summary.file_bytes = stored.file_bytes;
  summary.geo_anchor = stored.info.geo_anchor;
  return summary;
}

api::MapDescription DescriptionOf(const map::Snapshot& map) {
  const auto count = [](const auto& table) { return static_cast<std::int64_t>(table.size()); };
  api::MapDescription description;
  api::MapSummary& summary = description.summary;
  summary.id = map.info().id;
  summary.title = map.info().name;
  summary.revision = map.revision();
  summary.keyframes = count(map.keyframes());
  summary.points = count(map.points());
  summary.cameras = count(map.cameras());
  summary.components = count(map.components());
  summary.sessions = count(map.sessions());
  summary.geo_anchor = map.info().geo_anchor;
  description.orb = map.info().orb;
  for (const auto& [id, camera] : map.cameras()) {
    description.cameras.push_back({id, camera.name, camera.model, camera.lens.has_value()});
  }
  for (const auto& [id, component] : map.components()) {
    description.components.push_back({id, component.session, map.NumKeyframes(id), component.world_from_component,
                                      component.joined ? component.joined->into : ComponentId()});
  }
  const std::map<SessionId, TimeNs> newest = NewestKeyframes(map);
  for (const auto& [id, session] : map.sessions()) {
    map::Session told = session;
    if (!session.complete && newest.contains(id)) told.last_ns = std::max(session.last_ns, newest.at(id));
    told.settings_json.clear();
    told.loops.clear();
    told.trajectory.reset();
    description.sessions.push_back(std::move(told));
  }
  return description;
}

}  // namespace cairn::host
