// Going through the rows of a table where damage is told of and not the end: what opens maps and what checks them.
#pragma once

#include <cstdint>
#include <utility>

#include "absl/strings/str_cat.h"
#include "store/fault.h"
#include "store/sqlite.h"
#include "store/table_spec.h"
#include "store/tables.h"

namespace cairn::store {

// Gives `use` each row of a table as this format has it, with its key, in the order of the keys. Where a page cannot be
// read `report` (table, key, message) is told and the rest is left: what comes after it cannot be found.
template <class Report, class Use>
absl::Status ForEachRow(Database* database, const TableSpec& table, std::int64_t format, Report report, Use use) {
  CAIRN_ASSIGN_OR_RETURN(Statement rows,
                         database->Prepare(table.SelectSql(absl::StrCat("ORDER BY ", table.columns[0]), format)));
  while (true) {
    const absl::StatusOr<bool> found = rows.Step();
    if (!found.ok()) {
      if (!IsDamaged(found.status())) return found.status();
      return report(table.name, 0, found.status().message());
    }
    if (!*found) return absl::OkStatus();
    CAIRN_RETURN_IF_ERROR(use(rows, rows.Int(0)));
  }
}

// The same of a table with a row checksum: a row that does not fit it is reported, and left out.
template <class Value, class Report, class Use>
absl::Status ForEachChecked(Database* database, const TableSpec& table, std::int64_t format, Report report, Use use) {
  Row row;
  return ForEachRow(database, table, format, report, [&](const Statement& rows, std::int64_t id) -> absl::Status {
    Value value;
    if (const absl::Status status = ReadChecked(rows, &row, &value); !status.ok()) {
      return report(table.name, id, status.message());
    }
    return use(std::move(value));
  });
}

}  // namespace cairn::store
