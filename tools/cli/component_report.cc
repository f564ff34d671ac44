#include "cli/component_report.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <set>

#include "absl/strings/str_join.h"

namespace cairn::cli {
namespace {

std::map<ComponentId, std::set<SessionId>> SessionsOf(const map::Snapshot& map) {
  std::map<ComponentId, std::set<SessionId>> sessions;
  map.keyframes().ForEach([&](const auto& keyframe) { sessions[keyframe->component].insert(keyframe->session); });
  return sessions;
}

nlohmann::ordered_json WorldAsJson(const map::Component& component) {
  if (!component.world_from_component) return nullptr;
  const Sim3& s = *component.world_from_component;
  return {{"frame", "world"},
          {"unit", "m"},
          {"scale", s.scale()},
          {"translation", {s.translation().x(), s.translation().y(), s.translation().z()}},
          {"quaternion_xyzw", {s.rotation().x(), s.rotation().y(), s.rotation().z(), s.rotation().w()}}};
}

std::string Join(const std::set<SessionId>& ids) {
  return absl::StrJoin(ids, ", ", [](std::string* out, SessionId id) { absl::StrAppend(out, id.value()); });
}

}  // namespace

nlohmann::ordered_json ComponentsAsJson(const map::Snapshot& map) {
  auto sessions = SessionsOf(map);
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const auto& [id, component] : map.components()) {
    nlohmann::ordered_json of_sessions = nlohmann::ordered_json::array();
    for (const SessionId session : sessions[id]) of_sessions.push_back(session.value());
    json.push_back({{"id", id.value()},
                    {"keyframes", map.NumKeyframes(id)},
                    {"sessions", of_sessions},
                    {"begun_by_session", component.session.value()},
                    {"aligned", component.world_from_component.has_value()},
                    {"world_from_component", WorldAsJson(component)},
                    {"joined_into", nullptr}});
    if (!component.joined) continue;
    const map::ComponentJoin& join = *component.joined;
    json.back()["joined_into"] = join.into.value();
    json.back()["join"] = {{"revision", join.revision},
                           {"keyframe", join.keyframe.value()},
                           {"into_keyframe", join.into_keyframe.value()},
                           {"keyframe_time_s", ToSeconds(join.keyframe_time_ns)},
                           {"scale", join.into_from_component.scale()},
                           {"matches", join.matches},
                           {"keyframes_agreeing", join.keyframes_agreeing},
                           {"keyframes_checked", join.keyframes_checked}};
  }
  return json;
}

void PrintComponents(const map::Snapshot& map, const char* indent) {
  auto sessions = SessionsOf(map);
  const std::vector<ComponentId> live = map.LiveComponents();
  if (live.size() > 1) {
    std::printf("%s%zu components that nothing links, each with a place and scale of its own:\n", indent, live.size());
  }
  for (const ComponentId id : live) {
    const auto& world = map.WorldFrom(id);
    std::printf("%s%scomponent %u: %lld keyframes of session%s %s, %s", indent, live.size() > 1 ? "  " : "",
                id.value(), static_cast<long long>(map.NumKeyframes(id)), sessions[id].size() > 1 ? "s" : "",
                Join(sessions[id]).c_str(), world ? "aligned to the world" : "not aligned (cairn align)");
    if (world) std::printf(", scale %.4f", world->scale());
    std::printf("\n");
  }
  for (const auto& [id, component] : map.components()) {
    if (!component.joined) continue;
    std::printf("%s  component %u was joined to %u with revision %llu: %d matches, %d of %d keyframes agree\n", indent,
                id.value(), component.joined->into.value(),
                static_cast<unsigned long long>(component.joined->revision), component.joined->matches,
                component.joined->keyframes_agreeing, component.joined->keyframes_checked);
  }
}

std::vector<ComponentId> TogetherInOneFrame(const map::Snapshot& map) {
  std::vector<ComponentId> together;
  ComponentId largest;
  for (const ComponentId id : map.LiveComponents()) {
    if (map.WorldFrom(id)) together.push_back(id);
    if (!largest || map.NumKeyframes(id) > map.NumKeyframes(largest)) largest = id;
  }
  if (together.empty() && largest) together.push_back(largest);
  return together;
}

std::string NameComponents(const std::vector<ComponentId>& ids) {
  return absl::StrCat(ids.size() == 1 ? "component " : "components ",
                      absl::StrJoin(ids, ", ", [](std::string* out, ComponentId id) {
                        absl::StrAppend(out, id.value());
                      }));
}

}  // namespace cairn::cli
