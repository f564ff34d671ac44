// A page of the map ready to be queried (ready_pages.h) that says what there is: which session has how many keyframes
// in which component, so that an overview need not go through all of them; and how many rows the small tables have, so
// that one that is lost is missed.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/status.h"
#include "map/overview.h"
#include "store/map_assembly.h"
#include "store/sqlite.h"

namespace cairn::store {

struct ReadySummary {
  std::vector<map::KeyframeShare> shares;  // ascending by session and component
  std::vector<std::int64_t> rows;          // of the tables that describe the map, then of its log
};

// What describes a map, and what its log of changes is made of.
enum class Counted { kDescription, kLog };

// From the rows; formats before 4 name no component. Within a transaction, as all that follows.
absl::StatusOr<std::vector<map::KeyframeShare>> CountShares(Database* database, std::int64_t format);
absl::StatusOr<ReadySummary> Summarize(Database* database);

std::string PackReadySummary(const ReadySummary& summary);

// From the page if it is of the revision `newest`; nothing else, also where it cannot be read.
std::optional<ReadySummary> ReadReadySummary(Database* database, Revision newest);

// Tells of tables with other numbers of rows than the summary says, or than that page does.
absl::Status CompareRowCounts(const ReadySummary& summary, Database* database, Counted which, const FindingSink& sink);
absl::Status CheckRowCounts(Database* database, Revision newest, Counted which, const FindingSink& sink);

}  // namespace cairn::store
