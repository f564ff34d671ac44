// What a table of a map file is called and which columns it has, and the SQL that follows from it.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "store/sqlite.h"

namespace cairn::store {

// The formats that the code of this folder tells apart.
inline constexpr std::int64_t kNewestFormat = 4;

struct TableSpec {
  absl::string_view name;
  std::span<const absl::string_view> columns;  // the key first
  std::size_t num_keys = 1;
  // The table before format 4: without so many columns before the last, or as `before_4` says.
  std::size_t num_new_in_4 = 0;
  std::span<const absl::string_view> before_4 = {};

  // Whether the row, of SelectSql(), has all columns of the newest format.
  bool IsNewest(const Statement& row) const { return row.num_columns() == static_cast<int>(columns.size()); }

  // "SELECT <columns> FROM <name> <rest>", of the columns that a format has.
  std::string SelectSql(absl::string_view rest, std::int64_t format = kNewestFormat) const;
  // Inserts the row, or replaces everything but the key where there is one.
  std::string UpsertSql() const;
  // Replaces everything but the key of the row, if there is one.
  std::string UpdateSql() const;
};

}  // namespace cairn::store
