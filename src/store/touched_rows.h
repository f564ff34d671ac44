// Which rows a map file says were put or removed since a revision. Inside a read transaction.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "map/changed_rows.h"
#include "store/sqlite.h"
#include "store/tables.h"

namespace cairn::store {

// Ascending ids of a kind that changes after `since`, up to `until`, have put or removed; all below `next`.
absl::StatusOr<std::vector<std::uint32_t>> ReadTouched(Database* database, const TableSpec& table, Revision since,
                                                       std::uint32_t next,
                                                       Revision until = std::numeric_limits<std::int64_t>::max());

// MapStore::ReadChangedRows() of a map file.
absl::StatusOr<std::optional<map::ChangedRows>> ReadChangedRows(Database* database, Revision since);

}  // namespace cairn::store
