#include "store/table_spec.h"

#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace cairn::store {

std::string TableSpec::SelectSql(absl::string_view rest, std::int64_t format) const {
  std::vector<absl::string_view> selected(columns.begin(), columns.end());
  if (format < 4 && !before_4.empty()) {
    selected.assign(before_4.begin(), before_4.end());
  } else if (format < 4) {
    selected.erase(selected.end() - 1 - static_cast<std::ptrdiff_t>(num_new_in_4), selected.end() - 1);
  }
  return absl::StrCat("SELECT ", absl::StrJoin(selected, ", "), " FROM ", name, " ", rest);
}

std::string TableSpec::UpsertSql() const {
  std::string sql = absl::StrCat("INSERT INTO ", name, " (", absl::StrJoin(columns, ", "), ") VALUES (?");
  for (std::size_t i = 1; i < columns.size(); ++i) absl::StrAppend(&sql, ", ?");
  absl::StrAppend(&sql, ") ON CONFLICT (", absl::StrJoin(columns.first(num_keys), ", "), ") DO UPDATE SET ");
  const auto assign = [](std::string* out, absl::string_view column) {
    absl::StrAppend(out, column, " = excluded.", column);
  };
  return sql + absl::StrJoin(columns.subspan(num_keys), ", ", assign);
}

std::string TableSpec::UpdateSql() const {
  std::string sql = absl::StrCat("UPDATE ", name, " SET ");
  for (std::size_t i = num_keys; i < columns.size(); ++i) {
    absl::StrAppend(&sql, i > num_keys ? ", " : "", columns[i], " = ?", i + 1);
  }
  for (std::size_t i = 0; i < num_keys; ++i) {
    absl::StrAppend(&sql, i > 0 ? " AND " : " WHERE ", columns[i], " = ?", i + 1);
  }
  return sql;
}

}  // namespace cairn::store
