// SQLite's list of the pages that a map file has room in: what is on it is overwritten by the next change.
#pragma once

#include "base/status.h"
#include "store/map_assembly.h"
#include "store/sqlite.h"

namespace cairn::store {

// Tells `sink` of a list that cannot be, of pages on it that are in use, and of pages that are neither. Within a read
// transaction, of a file whose trees are sound. What has not come from the write-ahead log into the file yet is not
// known; the list is then looked at by itself.
absl::Status CheckFreePages(Database* database, const FindingSink& sink);

}  // namespace cairn::store
