// What verbs say of the components of a map.
#pragma once

#include <set>
#include <string>
#include <vector>

#include "cli/cli.h"
#include "map/overview.h"
#include "map/snapshot.h"

namespace cairn::cli {

struct ToldComponent {
  map::Component component;
  std::int64_t keyframes = 0;
  std::set<SessionId> sessions;  // that have keyframes there
};
// All of them, also those that were joined to others.
std::vector<ToldComponent> ToldComponents(const map::MapOverview& map);
std::vector<ToldComponent> ToldComponents(const map::Snapshot& map);

// Id, keyframes, sessions that have keyframes there, whether it is aligned, what it was joined to, when and by which
// evidence.
nlohmann::ordered_json ComponentsAsJson(const std::vector<ToldComponent>& components);
// A line each, for those with keyframes, the largest first, and for the joins; at most about `most` lines each.
void PrintComponents(const std::vector<ToldComponent>& components, const char* indent, std::size_t most);

// What a session that ended soon has left: a few keyframes in a component of their own that nothing has joined.
struct Fragment {
  ComponentId component;
  SessionId session;
  std::int64_t keyframes = 0;
};
// Beside a component that is larger, of sessions that have nothing else in the map. `may_run`: those that are not
// complete may be running.
std::vector<Fragment> FragmentsOf(const std::vector<ToldComponent>& components,
                                  const std::vector<map::Session>& sessions, bool may_run);
nlohmann::ordered_json FragmentsAsJson(const std::vector<Fragment>& fragments);
// What they are and how they are removed; nothing without any. `map`: as a command line names it.
void PrintFragments(const std::vector<Fragment>& fragments, const std::string& map, const char* indent);

// "component 2", or "components 1, 3"
std::string NameComponents(const std::vector<ComponentId>& ids);

}  // namespace cairn::cli
