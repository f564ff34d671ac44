// What is wrong with a map file, as one connection sees it.
#pragma once

#include <vector>

#include "base/status.h"
#include "store/map_store.h"
#include "store/sqlite.h"

namespace cairn::store {

// Within a read transaction of `database`. SQLite's own structures are looked at by `beside`, another connection to the
// same file, in a thread of its own; null: by `database` as well, one after the other.
absl::StatusOr<std::vector<Finding>> VerifyDatabase(Database* database, Database* beside);

}  // namespace cairn::store
