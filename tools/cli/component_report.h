// What verbs say of the components of a map.
#pragma once

#include <vector>

#include "cli/cli.h"
#include "map/snapshot.h"

namespace cairn::cli {

// All of them, also those that were joined to others: id, keyframes, sessions that have keyframes there, whether it is
// aligned, what it was joined to, when and by which evidence.
nlohmann::ordered_json ComponentsAsJson(const map::Snapshot& map);
// A line each, for those with keyframes, and one for the joins.
void PrintComponents(const map::Snapshot& map, const char* indent);

// Those that can be drawn or written together: all that are aligned, or else the one with most keyframes.
std::vector<ComponentId> TogetherInOneFrame(const map::Snapshot& map);

// "component 2", or "components 1, 3"
std::string NameComponents(const std::vector<ComponentId>& ids);

}  // namespace cairn::cli
