// What is left of a damaged map file, as a database that can be read: every row that lies whole anywhere in the file or
// its log, by its own checksum, whether SQLite would find it or not.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/status.h"
#include "store/sqlite.h"

namespace cairn::store {

struct Salvaged {
  std::unique_ptr<Database> rows;  // in memory; its tables have no constraint but what the format has
  std::int64_t num_rows = 0;
  std::vector<std::string> notes;  // what a user should know of how sure this is
};

// `log`: the write-ahead log of the file, or empty. DataLoss (without a fault) if nothing of a map is found.
absl::StatusOr<Salvaged> SalvageRows(const std::string& path, const std::string& log);

}  // namespace cairn::store
