#include "cli/component_report.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <set>

#include "absl/strings/str_join.h"
#include "text/text.h"

namespace cairn::cli {
namespace {

nlohmann::ordered_json WorldAsJson(const map::Component& component) {
  if (!component.world_from_component) return nullptr;
  const Sim3& s = *component.world_from_component;
  return {{"frame", "world"},
          {"unit", "m"},
          {"scale", s.scale()},
          {"translation", {s.translation().x(), s.translation().y(), s.translation().z()}},
          {"quaternion_xyzw", {s.rotation().x(), s.rotation().y(), s.rotation().z(), s.rotation().w()}}};
}

// A session that ends right after its first keyframes came into the map has there what the odometry's window held then,
// too: some eight to twelve.
constexpr std::int64_t kFew = 15;

std::string Join(const std::set<SessionId>& ids) {
  return absl::StrJoin(ids, ", ", [](std::string* out, SessionId id) { absl::StrAppend(out, id.value()); });
}

}  // namespace

std::vector<ToldComponent> ToldComponents(const map::MapOverview& map) {
  std::vector<ToldComponent> told;
  for (const map::Component& component : map.components) told.push_back({component, 0, {}});
  for (const map::KeyframeShare& share : map.shares) {
    const auto at =
        std::ranges::find(told, share.component, [](const ToldComponent& other) { return other.component.id; });
    if (at == told.end()) continue;
    at->keyframes += share.keyframes;
    at->sessions.insert(share.session);
  }
  return told;
}

std::vector<ToldComponent> ToldComponents(const map::Snapshot& map) {
  std::map<ComponentId, std::set<SessionId>> sessions;
  map.keyframes().ForEach([&](const auto& keyframe) { sessions[keyframe->component].insert(keyframe->session); });
  std::vector<ToldComponent> told;
  for (const auto& [id, component] : map.components()) told.push_back({component, map.NumKeyframes(id), sessions[id]});
  return told;
}

nlohmann::ordered_json ComponentsAsJson(const std::vector<ToldComponent>& components) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const auto& [component, keyframes, sessions] : components) {
    nlohmann::ordered_json of_sessions = nlohmann::ordered_json::array();
    for (const SessionId session : sessions) of_sessions.push_back(session.value());
    json.push_back({{"id", component.id.value()},
                    {"keyframes", keyframes},
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

void PrintComponents(const std::vector<ToldComponent>& components, const char* indent, std::size_t most) {
  std::vector<const ToldComponent*> live, joined;
  for (const ToldComponent& told : components) {
    if (told.keyframes > 0) live.push_back(&told);
    if (told.component.joined) joined.push_back(&told);
  }
  std::ranges::stable_sort(live, std::ranges::greater(), &ToldComponent::keyframes);
  if (live.size() > 1) {
    std::printf("%s%zu components, each with a place and scale of its own until it is aligned:\n", indent, live.size());
  }
  const char* deeper = live.size() > 1 ? "  " : "";
  for (std::size_t i = 0; i < std::min(live.size(), most); ++i) {
    const auto& [component, keyframes, sessions] = *live[i];
    const auto& world = component.world_from_component;
    const std::string of = sessions.size() > 4 ? absl::StrCat("s: ", sessions.size(), " of them")
                                               : absl::StrCat(sessions.size() > 1 ? "s " : " ", Join(sessions));
    std::printf("%s%scomponent %u: %s of session%s, %s", indent, deeper, component.id.value(),
                text::Keyframes(keyframes).c_str(), of.c_str(), world ? "aligned" : "not aligned (cairn align)");
    if (world) std::printf(", scale %.4f", world->scale());
    std::printf("\n");
  }
  if (live.size() > most) std::printf("%s%s... %zu more (ls MAP components)\n", indent, deeper, live.size() - most);
  for (std::size_t i = 0; i < std::min(joined.size(), most); ++i) {
    const map::ComponentJoin& join = *joined[i]->component.joined;
    std::printf("%s  component %u joined %u: %d matches, %d of %d keyframes agree (revision %llu)\n", indent,
                joined[i]->component.id.value(), join.into.value(), join.matches, join.keyframes_agreeing,
                join.keyframes_checked, static_cast<unsigned long long>(join.revision));
  }
  if (joined.size() > most) std::printf("%s  ... %zu more joined\n", indent, joined.size() - most);
}

std::vector<Fragment> FragmentsOf(const std::vector<ToldComponent>& components,
                                  const std::vector<map::Session>& sessions, bool may_run) {
  std::int64_t most = 0;
  std::set<ComponentId> joined;  // into which others were
  std::map<SessionId, int> begun;
  for (const auto& [component, keyframes, by] : components) {
    most = std::max(most, keyframes);
    if (component.joined) joined.insert(component.joined->into);
    ++begun[component.session];
  }
  std::map<ComponentId, int> touched;  // by sessions that have ended in order
  for (const map::Session& session : sessions) {
    for (const ComponentId id : session.components) ++touched[id];
  }
  std::vector<Fragment> fragments;
  for (const auto& [component, keyframes, by] : components) {
    const bool few = keyframes > 0 && keyframes < kFew && keyframes < most;
    const bool alone = !component.joined && !joined.contains(component.id) && !component.world_from_component &&
                       begun[component.session] == 1 && touched[component.id] <= 1;
    const auto session = std::ranges::find(sessions, component.session, &map::Session::id);
    if (!few || !alone || session == sessions.end() || (!session->complete && may_run)) continue;
    if (session->components.size() > 1) continue;
    fragments.push_back({component.id, component.session, keyframes});
  }
  return fragments;
}

nlohmann::ordered_json FragmentsAsJson(const std::vector<Fragment>& fragments) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const Fragment& fragment : fragments) {
    json.push_back({{"component", fragment.component.value()},
                    {"session", fragment.session.value()},
                    {"keyframes", fragment.keyframes}});
  }
  return json;
}

void PrintFragments(const std::vector<Fragment>& fragments, const std::string& map, const char* indent) {
  if (fragments.empty()) return;
  constexpr std::size_t kNamed = 8;
  const std::size_t named = std::min(fragments.size(), kNamed);
  std::string text = fragments.size() == 1 ? "a fragment" : absl::StrCat(fragments.size(), " fragments");
  absl::StrAppend(&text, ", of fewer than ", kFew, " keyframes that nothing links to the rest: ");
  for (std::size_t i = 0; i < named; ++i) {
    absl::StrAppend(&text, i == 0 ? "" : ", ", "component ", fragments[i].component.value(), " of session ",
                    fragments[i].session.value());
  }
  if (named < fragments.size()) absl::StrAppend(&text, ", ...");
  absl::StrAppend(
      &text,
      fragments.size() == 1 ? ". A visit to the same place may join it" : ". Visits to the same places may join them",
      "; to remove: cairn session remove ", map, " ",
      fragments.size() == 1 ? absl::StrCat(fragments[0].session.value()) : "SESSION");
  std::printf("%s", text::Wrapped(text, indent, absl::StrCat(indent, "  ")).c_str());
}

std::string NameComponents(const std::vector<ComponentId>& ids) {
  return absl::StrCat(
      ids.size() == 1 ? "component " : "components ",
      absl::StrJoin(ids, ", ", [](std::string* out, ComponentId id) { absl::StrAppend(out, id.value()); }));
}

}  // namespace cairn::cli
