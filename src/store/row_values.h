// Values that take several columns of a row or have a range: how they are put into one, and read back with a check.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "base/time.h"
#include "geometry/se3.h"
#include "store/row.h"

namespace cairn::store {

// What FromRow() says of a value that cannot be; `column`: as it is called in the table.
absl::Status OutOfRange(absl::string_view column);

// Each false if the value is out of its range.
template <class IdType>
bool IdOf(std::int64_t value, IdType* id) {
  if (value < 1 || value > std::numeric_limits<std::uint32_t>::max()) return false;
  *id = IdType(static_cast<std::uint32_t>(value));
  return true;
}
bool IntOf(std::int64_t stored, int* value);

// The same from `column` on.
template <class IdType>
bool ReadId(const Statement& row, int column, IdType* id) {
  return IdOf(row.Int(column), id);
}
// 0: none.
template <class IdType>
bool ReadIdOrNone(const Statement& row, int column, IdType* id) {
  *id = IdType();
  return row.Int(column) == 0 || ReadId(row, column, id);
}
bool ReadInt(const Statement& row, int column, int* value);
bool ReadRevision(const Statement& row, int column, Revision* revision);

// NULL for none.
template <class IdType>
void AddIdOrNull(IdType id, Row* row) {
  if (id) {
    row->Int(id.value());
  } else {
    row->Null();
  }
}
template <class IdType>
bool ReadIdOrNull(const Statement& row, int column, IdType* id) {
  *id = IdType();
  return row.ColumnType(column) == Statement::Type::kNull || ReadId(row, column, id);
}

// "1,2,5"
std::string IdList(const std::vector<ComponentId>& ids);
bool ReadIdList(absl::string_view text, std::vector<ComponentId>* ids);

// Seven columns: the rotation as x, y, z, w, then the translation. `name`: of the transform, for the error.
void AddRigid(const SE3& pose, Row* row);
absl::Status ReadRigid(const Statement& row, int column, absl::string_view name, SE3* pose);
// Eight columns, the scale first; all NULL: none.
void AddSimilarity(const std::optional<Sim3>& similarity, Row* row);
absl::Status ReadSimilarity(const Statement& row, int column, absl::string_view name, std::optional<Sim3>* similarity);

}  // namespace cairn::store
