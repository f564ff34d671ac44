// What is wrong with a map, in JSON.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "map/history.h"

namespace cairn::cli {

// A list of {table, id, message}.
nlohmann::ordered_json FindingsAsJson(const std::vector<map::Finding>& findings);

}  // namespace cairn::cli
