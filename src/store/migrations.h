// Brings the tables of a database to a format: the numbered files of schema/, compiled in, each applied once in its
// order.
#pragma once

#include <functional>
#include <span>

#include "absl/strings/string_view.h"
#include "base/status.h"
#include "store/sqlite.h"

namespace cairn::store {

struct Migration {
  int version = 0;         // of the format that it leads to: 1, 2, ... without gaps
  absl::string_view name;  // of the file, for messages
  absl::string_view sql;
};

// The contents of schema/*.sql, ascending.
std::span<const Migration> BuiltInMigrations();

// SQLite's application_id of a Cairn map: "CAIR".
inline constexpr std::int64_t kApplicationId = 0x43414952;

// Applies what is newer than the database's user_version, and then `fill` to what is in the tables, all in one
// transaction: after an error nothing has changed. Fault kNewerVersion if the database is newer than the last
// migration.
absl::Status Migrate(Database* database, std::span<const Migration> migrations,
                     const std::function<absl::Status()>& fill = nullptr);

}  // namespace cairn::store
