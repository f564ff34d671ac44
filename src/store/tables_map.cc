// Rows of the tables about the map as a whole: what it is, and what changed it.
#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "store/row_values.h"
#include "store/tables.h"

namespace cairn::store {

// --- map ---

Row RowOf(const MapRow& value) {
  const map::MapInfo& info = value.info;
  Row row;
  row.Int(1).Text(info.id).Text(info.name).Text(info.software_version).Int(info.created_unix_ns);
  row.Int(info.orb.num_features).Int(info.orb.num_levels).Real(info.orb.scale_factor);
  row.Int(info.orb.fast_threshold).Int(info.orb.min_fast_threshold);
  if (info.vocabulary_hash != 0) {
    row.TextCopy(absl::StrFormat("%016x", info.vocabulary_hash));
  } else {
    row.Null();
  }
  row.Int(static_cast<std::int64_t>(value.revision)).Int(value.next_keyframe.value()).Int(value.next_point.value());
  row.Int(value.keyframe_count).Int(value.point_count).Int(value.covisibility_count);
  row.Text(value.log_token).Text(value.previous_log_token).Int(value.log_schema_cookie);
  row.Int(value.next_camera.value()).Int(value.next_session.value()).Int(value.next_component.value());
  if (const auto& anchor = info.geo_anchor) {
    row.Real(anchor->latitude_deg).Real(anchor->longitude_deg).Real(anchor->height_m);
    const Quaterniond& rotation = anchor->enu_from_world;
    row.Real(rotation.x()).Real(rotation.y()).Real(rotation.z()).Real(rotation.w());
  } else {
    for (int i = 0; i < 7; ++i) row.Null();
  }
  row.Int(static_cast<std::int64_t>(value.info_revision)).Int(static_cast<std::int64_t>(value.oldest_delta_base));
  return row;
}

namespace {

// The columns up to the vocabulary, the same in all formats.
absl::Status ReadInfo(const Statement& row, map::MapInfo* info) {
  info->id = std::string(row.Text(1));
  info->name = std::string(row.Text(2));
  info->software_version = std::string(row.Text(3));
  info->created_unix_ns = row.Int(4);
  if (!ReadInt(row, 5, &info->orb.num_features) || !ReadInt(row, 6, &info->orb.num_levels) ||
      !ReadInt(row, 8, &info->orb.fast_threshold) || !ReadInt(row, 9, &info->orb.min_fast_threshold)) {
    return OutOfRange("orb_...");
  }
  info->orb.scale_factor = row.Real(7);
  CAIRN_RETURN_IF_ERROR(info->orb.Validate());
  info->vocabulary_hash = 0;
  if (row.ColumnType(10) != Statement::Type::kNull && !absl::SimpleHexAtoi(row.Text(10), &info->vocabulary_hash)) {
    return OutOfRange("vocabulary_hash");
  }
  return absl::OkStatus();
}

// The columns from the revision on that all formats have, the first of them at `column`.
absl::Status ReadCounts(const Statement& row, int column, MapRow* value) {
  if (!ReadRevision(row, column, &value->revision)) return OutOfRange("revision");
  if (!ReadId(row, column + 1, &value->next_keyframe)) return OutOfRange("next_keyframe");
  if (!ReadId(row, column + 2, &value->next_point)) return OutOfRange("next_point");
  value->keyframe_count = row.Int(column + 3);
  value->point_count = row.Int(column + 4);
  value->covisibility_count = row.Int(column + 5);
  return absl::OkStatus();
}

}  // namespace

absl::Status FromRow(const Statement& row, MapRow* value) {
  CAIRN_RETURN_IF_ERROR(ReadInfo(row, &value->info));
  value->world_from_map.reset();
  value->info.geo_anchor.reset();
  if (!kMapTable.IsNewest(row)) {
    CAIRN_RETURN_IF_ERROR(ReadSimilarity(row, 11, "world_from_map", &value->world_from_map));
    return ReadCounts(row, 19, value);
  }
  CAIRN_RETURN_IF_ERROR(ReadCounts(row, 11, value));
  value->log_token = std::string(row.Text(17));
  value->previous_log_token = std::string(row.Text(18));
  value->log_schema_cookie = row.Int(19);
  if (!ReadId(row, 20, &value->next_camera)) return OutOfRange("next_camera");
  if (!ReadId(row, 21, &value->next_session)) return OutOfRange("next_session");
  if (!ReadId(row, 22, &value->next_component)) return OutOfRange("next_component");
  if (row.ColumnType(23) != Statement::Type::kNull) {
    map::GeoAnchor anchor;
    anchor.latitude_deg = row.Real(23);
    anchor.longitude_deg = row.Real(24);
    anchor.height_m = row.Real(25);
    anchor.enu_from_world = Quaterniond(row.Real(29), row.Real(26), row.Real(27), row.Real(28));
    CAIRN_RETURN_IF_ERROR(anchor.Validate());
    value->info.geo_anchor = anchor;
  }
  if (!ReadRevision(row, 30, &value->info_revision)) return OutOfRange("info_revision");
  if (!ReadRevision(row, 31, &value->oldest_delta_base)) return OutOfRange("oldest_delta_base");
  return absl::OkStatus();
}

// --- changes ---

Row RowOf(const LoggedChange& value) {
  Row row;
  row.Int(static_cast<std::int64_t>(value.revision)).Text(value.reason).Int(value.committed_unix_ns);
  row.Int(value.keyframes_put).Int(value.keyframes_removed).Int(value.points_put).Int(value.points_removed);
  AddIdOrNull(value.session, &row);
  row.TextCopy(IdList(value.components)).Int(value.cameras_put).Int(value.cameras_removed).Int(value.sessions_put);
  row.Int(value.components_put).Int(value.components_removed).Int(value.info_put ? 1 : 0);
  return row;
}

absl::Status FromRow(const Statement& row, LoggedChange* value) {
  value->revision = static_cast<Revision>(row.Int(0));
  value->reason = std::string(row.Text(1));
  value->committed_unix_ns = row.Int(2);
  value->keyframes_put = row.Int(3);
  value->keyframes_removed = row.Int(4);
  value->points_put = row.Int(5);
  value->points_removed = row.Int(6);
  if (!kChangesTable.IsNewest(row)) return absl::OkStatus();
  if (!ReadIdOrNull(row, 7, &value->session)) return OutOfRange("session");
  if (!ReadIdList(row.Text(8), &value->components)) return OutOfRange("components");
  value->cameras_put = row.Int(9);
  value->cameras_removed = row.Int(10);
  value->sessions_put = row.Int(11);
  value->components_put = row.Int(12);
  value->components_removed = row.Int(13);
  value->info_put = row.Int(14) != 0;
  return absl::OkStatus();
}

}  // namespace cairn::store
