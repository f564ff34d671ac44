// What a verb that makes a map smaller says of what that costs (care/self_queries.h).
#pragma once

#include <nlohmann/json.hpp>

#include "care/self_queries.h"

namespace cairn::cli {

// "views", "found_before", "found_after", "relocalization_loss" and "relocalization_loss_at_most" of whole images, and
// an object "halves" with the same of halves.
nlohmann::ordered_json SelfQueriesAsJson(const care::SelfQueries& queries);

void PrintSelfQueries(const care::SelfQueries& queries);

}  // namespace cairn::cli
