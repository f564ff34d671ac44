#include "store/row_values.h"

#include <cmath>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"

namespace cairn::store {
namespace {

void AddPose(const Quaterniond& rotation, const Vector3d& translation, Row* row) {
  row->Real(rotation.x()).Real(rotation.y()).Real(rotation.z()).Real(rotation.w());
  row->Real(translation.x()).Real(translation.y()).Real(translation.z());
}

// Seven columns; false if the rotation is not of unit length or a number is not finite.
bool ReadPose(const Statement& row, int column, Quaterniond* rotation, Vector3d* translation) {
  *rotation = Quaterniond(row.Real(column + 3), row.Real(column), row.Real(column + 1), row.Real(column + 2));
  *translation = Vector3d(row.Real(column + 4), row.Real(column + 5), row.Real(column + 6));
  return std::abs(rotation->norm() - 1.0) < 1e-6 && translation->allFinite();
}

}  // namespace

absl::Status OutOfRange(absl::string_view column) {
  return absl::DataLossError(absl::StrCat("column ", column, " is out of its range"));
}

bool IntOf(std::int64_t stored, int* value) {
  if (stored < std::numeric_limits<int>::min() || stored > std::numeric_limits<int>::max()) return false;
  *value = static_cast<int>(stored);
  return true;
}

bool ReadInt(const Statement& row, int column, int* value) { return IntOf(row.Int(column), value); }

bool ReadRevision(const Statement& row, int column, Revision* revision) {
  if (row.Int(column) < 0) return false;
  *revision = static_cast<Revision>(row.Int(column));
  return true;
}

std::string IdList(const std::vector<ComponentId>& ids) {
  return absl::StrJoin(ids, ",", [](std::string* out, ComponentId id) { absl::StrAppend(out, id.value()); });
}

bool ReadIdList(absl::string_view text, std::vector<ComponentId>* ids) {
  ids->clear();
  if (text.empty()) return true;
  for (const absl::string_view part : absl::StrSplit(text, ',')) {
    std::uint32_t id = 0;
    if (!absl::SimpleAtoi(part, &id) || id == 0) return false;
    ids->push_back(ComponentId(id));
  }
  return true;
}

void AddRigid(const SE3& pose, Row* row) { AddPose(pose.rotation(), pose.translation(), row); }

absl::Status ReadRigid(const Statement& row, int column, absl::string_view name, SE3* pose) {
  Quaterniond rotation;
  Vector3d translation;
  if (!ReadPose(row, column, &rotation, &translation)) {
    return absl::DataLossError(absl::StrCat(name, " is not a rigid transform"));
  }
  *pose = SE3::FromUnit(rotation, translation);
  return absl::OkStatus();
}

void AddSimilarity(const std::optional<Sim3>& similarity, Row* row) {
  if (!similarity) {
    for (int i = 0; i < 8; ++i) row->Null();
    return;
  }
  row->Real(similarity->scale());
  AddPose(similarity->rotation(), similarity->translation(), row);
}

absl::Status ReadSimilarity(const Statement& row, int column, absl::string_view name, std::optional<Sim3>* similarity) {
  similarity->reset();
  if (row.ColumnType(column) == Statement::Type::kNull) return absl::OkStatus();
  Quaterniond rotation;
  Vector3d translation;
  const double scale = row.Real(column);
  if (!ReadPose(row, column + 1, &rotation, &translation) || !std::isfinite(scale) || scale <= 0.0) {
    return absl::DataLossError(absl::StrCat(name, " is not a similarity transform"));
  }
  *similarity = Sim3::FromUnit(rotation, translation, scale);
  return absl::OkStatus();
}

}  // namespace cairn::store
