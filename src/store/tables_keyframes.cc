// Rows of the tables that grow: keyframes, points, and what keyframes share.
#include "store/row_values.h"
#include "store/tables.h"

namespace cairn::store {

// --- keyframes ---

Row RowOf(const map::Keyframe& value, Revision revision) {
  Row row;
  row.Int(value.id.value()).Int(value.session.value()).Int(value.camera.value());
  row.Int(value.time_ns).Int(value.frame_index);
  AddRigid(value.camera_from_map, &row);
  AddRigid(value.camera_from_direct, &row);
  row.Int(value.direct_segment);
  AddIdOrNull(value.parent, &row);
  row.Int(value.component.value()).Int(static_cast<std::int64_t>(revision));
  return row;
}

absl::Status FromRow(const Statement& row, map::Keyframe* value) {
  if (!ReadId(row, 0, &value->id)) return OutOfRange("id");
  if (!ReadId(row, 1, &value->session)) return OutOfRange("session");
  if (!ReadId(row, 2, &value->camera)) return OutOfRange("camera");
  value->time_ns = row.Int(3);
  value->frame_index = row.Int(4);
  CAIRN_RETURN_IF_ERROR(ReadRigid(row, 5, "camera_from_map", &value->camera_from_map));
  CAIRN_RETURN_IF_ERROR(ReadRigid(row, 12, "camera_from_direct", &value->camera_from_direct));
  value->direct_segment = row.Int(19);
  if (!ReadIdOrNull(row, 20, &value->parent)) return OutOfRange("parent");
  const bool has_component = kKeyframesTable.IsNewest(row);
  if (has_component && !ReadId(row, 21, &value->component)) return OutOfRange("component");
  return absl::OkStatus();
}

// --- points ---

Row RowOf(const PointRow& value, Revision revision) {
  Row row;
  row.Int(value.id.value()).Real(value.position.x()).Real(value.position.y()).Real(value.position.z());
  row.Int(value.reference_keyframe.value()).Int(value.times_visible).Int(value.times_found);
  row.Int(static_cast<std::int64_t>(revision));
  return row;
}

absl::Status FromCells(const Row& row, PointRow* value) {
  if (!IdOf(row.IntAt(0), &value->id)) return OutOfRange("id");
  value->position = Vector3d(row.RealAt(1), row.RealAt(2), row.RealAt(3));
  if (!value->position.allFinite()) return OutOfRange("x, y, z");
  if (!IdOf(row.IntAt(4), &value->reference_keyframe)) return OutOfRange("reference_keyframe");
  if (!IntOf(row.IntAt(5), &value->times_visible)) return OutOfRange("times_visible");
  if (!IntOf(row.IntAt(6), &value->times_found)) return OutOfRange("times_found");
  return absl::OkStatus();
}

// --- covisibility ---

Row RowOf(const EdgeRow& value) {
  Row row;
  row.Int(value.a.value()).Int(value.b.value()).Int(value.shared_points);
  return row;
}

absl::Status FromRow(const Statement& row, EdgeRow* value) {
  if (!ReadId(row, 0, &value->a) || !ReadId(row, 1, &value->b) || !(value->a < value->b)) {
    return OutOfRange("keyframe_a, keyframe_b");
  }
  if (!ReadInt(row, 2, &value->shared_points) || value->shared_points < 1) return OutOfRange("shared_points");
  return absl::OkStatus();
}

}  // namespace cairn::store
