// Brings a map file of an older format up to date.
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "store/sqlite.h"

namespace cairn::store {

// In one transaction, after a copy of the map as it was has been put beside it (`<path>.format3-backup`, with a number
// behind it if there is one already). What was done is added to `notes`. Nothing if the format is the newest. The
// caller holds the right to write; the map is read whole, and refused if anything in it is damaged.
absl::Status UpgradeFormat(Database* database, const std::string& path, std::vector<std::string>* notes);

}  // namespace cairn::store
