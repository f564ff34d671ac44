#include "store/tables.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <limits>
#include <vector>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_split.h"
#include "store/blobs.h"

namespace cairn::store {
namespace {

using std::int64_t;
using StringView = absl::string_view;

constexpr std::array<StringView, 33> kMapColumns = {
    "id",
    "map_id",
    "name",
    "software_version",
    "created_unix_ns",
    "orb_num_features",
    "orb_num_levels",
    "orb_scale_factor",
    "orb_fast_threshold",
    "orb_min_fast_threshold",
    "vocabulary_hash",
    "revision",
    "next_keyframe",
    "next_point",
    "keyframe_count",
    "point_count",
    "covisibility_count",
    "log_token",
    "previous_log_token",
    "log_schema_cookie",
    "next_camera",
    "next_session",
    "next_component",
    "geo_latitude_deg",
    "geo_longitude_deg",
    "geo_height_m",
    "geo_enu_from_world_qx",
    "geo_enu_from_world_qy",
    "geo_enu_from_world_qz",
    "geo_enu_from_world_qw",
    "info_revision",
    "oldest_delta_base",
    "row_checksum",
};
constexpr std::array<StringView, 26> kMapColumnsBefore4 = {
    "id",
    "map_id",
    "name",
    "software_version",
    "created_unix_ns",
    "orb_num_features",
    "orb_num_levels",
    "orb_scale_factor",
    "orb_fast_threshold",
    "orb_min_fast_threshold",
    "vocabulary_hash",
    "world_from_map_scale",
    "world_from_map_qx",
    "world_from_map_qy",
    "world_from_map_qz",
    "world_from_map_qw",
    "world_from_map_tx",
    "world_from_map_ty",
    "world_from_map_tz",
    "revision",
    "next_keyframe",
    "next_point",
    "keyframe_count",
    "point_count",
    "covisibility_count",
    "row_checksum",
};
constexpr std::array<StringView, 18> kCamerasColumns = {
    "id",
    "name",
    "model",
    "width_px",
    "height_px",
    "fx_px",
    "fy_px",
    "cx_px",
    "cy_px",
    "distortion",
    "pinhole_width_px",
    "pinhole_height_px",
    "pinhole_fx_px",
    "pinhole_fy_px",
    "pinhole_cx_px",
    "pinhole_cy_px",
    "revision",
    "row_checksum",
};
constexpr std::array<StringView, 5> kLensesColumns = {"camera", "focal_scale", "k1", "k2", "row_checksum"};
constexpr std::array<StringView, 16> kSessionsColumns = {
    "id",      "camera",          "source",        "software_version", "settings_json", "first_ns",
    "last_ns", "started_unix_ns", "ended_unix_ns", "complete",         "removed",       "policy",
    "result",  "components",      "revision",      "row_checksum",
};
constexpr std::array<StringView, 29> kComponentsColumns = {
    "id",
    "session",
    "world_from_component_scale",
    "world_from_component_qx",
    "world_from_component_qy",
    "world_from_component_qz",
    "world_from_component_qw",
    "world_from_component_tx",
    "world_from_component_ty",
    "world_from_component_tz",
    "joined_into",
    "into_from_component_scale",
    "into_from_component_qx",
    "into_from_component_qy",
    "into_from_component_qz",
    "into_from_component_qw",
    "into_from_component_tx",
    "into_from_component_ty",
    "into_from_component_tz",
    "joined_keyframe",
    "joined_into_keyframe",
    "joined_keyframe_time_ns",
    "joined_matches",
    "joined_keyframes_agreeing",
    "joined_keyframes_checked",
    "joined_revision",
    "joined_unix_ns",
    "revision",
    "row_checksum",
};
constexpr std::array<StringView, 4> kTouchedColumns = {"revision", "kind", "ids_checksum", "ids"};
constexpr std::array<StringView, 12> kLoopsColumns = {
    "session", "number", "keyframe", "keyframe_time_ns", "loop_keyframe", "loop_time_ns",
    "matches", "scale",  "shift",    "turn_rad",         "way",           "row_checksum",
};
constexpr std::array<StringView, 6> kTrajectoriesColumns = {
    "session", "refined", "keyframes", "collinear", "reason", "row_checksum",
};
constexpr std::array<StringView, 24> kKeyframesColumns = {
    "id",
    "session",
    "camera",
    "time_ns",
    "frame_index",
    "camera_from_map_qx",
    "camera_from_map_qy",
    "camera_from_map_qz",
    "camera_from_map_qw",
    "camera_from_map_tx",
    "camera_from_map_ty",
    "camera_from_map_tz",
    "camera_from_direct_qx",
    "camera_from_direct_qy",
    "camera_from_direct_qz",
    "camera_from_direct_qw",
    "camera_from_direct_tx",
    "camera_from_direct_ty",
    "camera_from_direct_tz",
    "direct_segment",
    "parent",
    "component",
    "revision",
    "row_checksum",
};
constexpr std::array<StringView, 9> kPointsColumns = {
    "id", "x", "y", "z", "reference_keyframe", "times_visible", "times_found", "revision", "row_checksum",
};
constexpr std::array<StringView, 4> kCovisibilityColumns = {
    "keyframe_a",
    "keyframe_b",
    "shared_points",
    "row_checksum",
};
constexpr std::array<StringView, 16> kChangesColumns = {
    "revision",        "reason",         "committed_unix_ns", "keyframes_put",      "keyframes_removed",
    "points_put",      "points_removed", "session",           "components",         "cameras_put",
    "cameras_removed", "sessions_put",   "components_put",    "components_removed", "info_put",
    "row_checksum",
};
constexpr std::array<StringView, 11> kFeaturesColumns = {
    "keyframe",       "feature_count", "keypoint_layout", "word_bytes", "keypoints_checksum", "descriptors_checksum",
    "words_checksum", "keypoints",     "descriptors",     "words",      "revision",
};
constexpr std::array<StringView, 4> kKeyframePointsColumns = {
    "keyframe",
    "point_ids_checksum",
    "point_ids",
    "revision",
};
constexpr std::array<StringView, 3> kVocabularyColumns = {"id", "bytes_checksum", "bytes"};

absl::Status OutOfRange(StringView column) {
  return absl::DataLossError(absl::StrCat("column ", column, " is out of its range"));
}

template <class IdType>
bool ReadId(const Statement& row, int column, IdType* id) {
  const int64_t value = row.Int(column);
  if (value < 1 || value > std::numeric_limits<std::uint32_t>::max()) return false;
  *id = IdType(static_cast<std::uint32_t>(value));
  return true;
}

bool ReadInt(const Statement& row, int column, int* value) {
  const int64_t stored = row.Int(column);
  if (stored < std::numeric_limits<int>::min() || stored > std::numeric_limits<int>::max()) return false;
  *value = static_cast<int>(stored);
  return true;
}

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

bool ReadRevision(const Statement& row, int column, Revision* revision) {
  if (row.Int(column) < 0) return false;
  *revision = static_cast<Revision>(row.Int(column));
  return true;
}

void AddSimilarity(const std::optional<Sim3>& similarity, Row* row) {
  if (!similarity) {
    for (int i = 0; i < 8; ++i) row->Null();
    return;
  }
  row->Real(similarity->scale());
  AddPose(similarity->rotation(), similarity->translation(), row);
}

// Eight columns, the scale first; all NULL: none.
absl::Status ReadSimilarity(const Statement& row, int column, StringView name, std::optional<Sim3>* similarity) {
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

template <class IdType>
bool ReadIdOrNone(const Statement& row, int column, IdType* id) {
  *id = IdType();
  return row.Int(column) == 0 || ReadId(row, column, id);
}

// The enumerator of that name.
template <class Enum>
bool FindNamed(std::initializer_list<Enum> all, const char* (*name_of)(Enum), StringView name, Enum* value) {
  const auto found = std::find_if(all.begin(), all.end(), [&](Enum one) { return name == name_of(one); });
  if (found == all.end()) return false;
  *value = *found;
  return true;
}

// "1,2,5"
std::string IdList(const std::vector<ComponentId>& ids) {
  return absl::StrJoin(ids, ",", [](std::string* out, ComponentId id) { absl::StrAppend(out, id.value()); });
}

bool ReadIdList(StringView text, std::vector<ComponentId>* ids) {
  ids->clear();
  if (text.empty()) return true;
  for (const StringView part : absl::StrSplit(text, ',')) {
    std::uint32_t id = 0;
    if (!absl::SimpleAtoi(part, &id) || id == 0) return false;
    ids->push_back(ComponentId(id));
  }
  return true;
}

absl::Status ReadRigid(const Statement& row, int column, StringView name, SE3* pose) {
  Quaterniond rotation;
  Vector3d translation;
  if (!ReadPose(row, column, &rotation, &translation)) {
    return absl::DataLossError(absl::StrCat(name, " is not a rigid transform"));
  }
  *pose = SE3::FromUnit(rotation, translation);
  return absl::OkStatus();
}

}  // namespace

const TableSpec kMapTable{"map", kMapColumns, 1, 0, kMapColumnsBefore4};
const TableSpec kCamerasTable{"cameras", kCamerasColumns, 1, 1};
const TableSpec kLensesTable{"lenses", kLensesColumns};
const TableSpec kSessionsTable{"sessions", kSessionsColumns, 1, 5};
const TableSpec kComponentsTable{"components", kComponentsColumns};
const TableSpec kLoopsTable{"loops", kLoopsColumns, 2};
const TableSpec kTrajectoriesTable{"reported_trajectories", kTrajectoriesColumns};
const TableSpec kKeyframesTable{"keyframes", kKeyframesColumns, 1, 2};
const TableSpec kPointsTable{"points", kPointsColumns, 1, 1};
const TableSpec kCovisibilityTable{"covisibility", kCovisibilityColumns, 2};
const TableSpec kChangesTable{"changes", kChangesColumns, 1, 8};
const TableSpec kFeaturesTable{"keyframe_features", kFeaturesColumns, 1, 0, std::span(kFeaturesColumns).first(10)};
const TableSpec kKeyframePointsTable{"keyframe_points", kKeyframePointsColumns, 1, 0,
                                     std::span(kKeyframePointsColumns).first(3)};
const TableSpec kVocabularyTable{"vocabulary", kVocabularyColumns};
const TableSpec kTouchedTable{"touched", kTouchedColumns, 2};

std::string TableSpec::SelectSql(StringView rest, std::int64_t format) const {
  std::vector<StringView> selected(columns.begin(), columns.end());
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
  const auto assign = [](std::string* out, StringView column) { absl::StrAppend(out, column, " = excluded.", column); };
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
  row.Int(static_cast<int64_t>(value.revision)).Int(value.next_keyframe.value()).Int(value.next_point.value());
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
  row.Int(static_cast<int64_t>(value.info_revision)).Int(static_cast<int64_t>(value.oldest_delta_base));
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
  if (row.num_columns() == static_cast<int>(kMapColumnsBefore4.size())) {
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

// --- cameras ---

Row RowOf(const map::MapCamera& value, Revision revision, std::string* distortion_blob) {
  *distortion_blob = PackDoubles(value.model.distortion);
  const Camera& model = value.model;
  const Pinhole& pinhole = value.pinhole;
  Row row;
  row.Int(value.id.value())
      .Text(value.name)
      .Text(CameraModelName(model.model))
      .Int(model.width_px)
      .Int(model.height_px);
  row.Real(model.fx_px).Real(model.fy_px).Real(model.cx_px).Real(model.cy_px).Blob(AsBytes(*distortion_blob));
  row.Int(pinhole.width_px).Int(pinhole.height_px);
  row.Real(pinhole.fx_px).Real(pinhole.fy_px).Real(pinhole.cx_px).Real(pinhole.cy_px);
  row.Int(static_cast<int64_t>(revision));
  return row;
}

absl::Status FromRow(const Statement& row, map::MapCamera* value) {
  if (!ReadId(row, 0, &value->id)) return OutOfRange("id");
  value->name = std::string(row.Text(1));
  Camera& model = value->model;
  CAIRN_ASSIGN_OR_RETURN(model.model, CameraModelFromName(row.Text(2)));
  if (!ReadInt(row, 3, &model.width_px) || !ReadInt(row, 4, &model.height_px)) return OutOfRange("width_px, height_px");
  model.fx_px = row.Real(5);
  model.fy_px = row.Real(6);
  model.cx_px = row.Real(7);
  model.cy_px = row.Real(8);
  CAIRN_ASSIGN_OR_RETURN(model.distortion, UnpackDoubles(row.Blob(9)));
  CAIRN_RETURN_IF_ERROR(model.Validate());
  Pinhole& pinhole = value->pinhole;
  if (!ReadInt(row, 10, &pinhole.width_px) || !ReadInt(row, 11, &pinhole.height_px)) {
    return OutOfRange("pinhole_width_px, pinhole_height_px");
  }
  pinhole.fx_px = row.Real(12);
  pinhole.fy_px = row.Real(13);
  pinhole.cx_px = row.Real(14);
  pinhole.cy_px = row.Real(15);
  return Camera::FromPinhole(pinhole).Validate();
}

// --- lenses ---

Row RowOf(const LensRow& value) {
  Row row;
  row.Int(value.camera.value()).Real(value.lens.focal_scale).Real(value.lens.k1).Real(value.lens.k2);
  return row;
}

absl::Status FromRow(const Statement& row, LensRow* value) {
  if (!ReadId(row, 0, &value->camera)) return OutOfRange("camera");
  value->lens = {row.Real(1), row.Real(2), row.Real(3)};
  return value->lens.Validate().ok() ? absl::OkStatus() : OutOfRange("focal_scale, k1, k2");
}

// --- sessions ---

Row RowOf(const map::Session& value, Revision revision) {
  Row row;
  row.Int(value.id.value()).Int(value.camera.value()).Text(value.source).Text(value.software_version);
  row.Text(value.settings_json).Int(value.first_ns).Int(value.last_ns);
  row.Int(value.started_unix_ns).Int(value.ended_unix_ns).Int(value.complete ? 1 : 0);
  row.Int(value.removed ? 1 : 0).Text(SessionPolicyName(value.policy)).Text(SessionResultName(value.result));
  row.TextCopy(IdList(value.components)).Int(static_cast<int64_t>(revision));
  return row;
}

absl::Status FromRow(const Statement& row, map::Session* value) {
  if (!ReadId(row, 0, &value->id)) return OutOfRange("id");
  if (!ReadId(row, 1, &value->camera)) return OutOfRange("camera");
  value->source = std::string(row.Text(2));
  value->software_version = std::string(row.Text(3));
  value->settings_json = std::string(row.Text(4));
  value->first_ns = row.Int(5);
  value->last_ns = row.Int(6);
  value->started_unix_ns = row.Int(7);
  value->ended_unix_ns = row.Int(8);
  value->complete = row.Int(9) != 0;
  if (row.num_columns() < static_cast<int>(kSessionsColumns.size())) {
    // Before format 4 there was nothing but to create a map. The components come with their assignment.
    value->result = value->complete ? map::SessionResult::kCreated : map::SessionResult::kUnknown;
    return absl::OkStatus();
  }
  value->removed = row.Int(10) != 0;
  if (!FindNamed({map::SessionPolicy::kCreate, map::SessionPolicy::kExtend}, map::SessionPolicyName, row.Text(11),
                 &value->policy)) {
    return OutOfRange("policy");
  }
  if (!FindNamed({map::SessionResult::kUnknown, map::SessionResult::kCreated, map::SessionResult::kLocated,
                  map::SessionResult::kApart},
                 map::SessionResultName, row.Text(12), &value->result)) {
    return OutOfRange("result");
  }
  return ReadIdList(row.Text(13), &value->components) ? absl::OkStatus() : OutOfRange("components");
}

// --- components ---

Row RowOf(const map::Component& value, Revision revision) {
  Row row;
  row.Int(value.id.value());
  if (value.session) {
    row.Int(value.session.value());
  } else {
    row.Null();
  }
  AddSimilarity(value.world_from_component, &row);
  if (const auto& joined = value.joined) {
    row.Int(joined->into.value());
    AddSimilarity(joined->into_from_component, &row);
    row.Int(joined->keyframe.value()).Int(joined->into_keyframe.value()).Int(joined->keyframe_time_ns);
    row.Int(joined->matches).Int(joined->keyframes_agreeing).Int(joined->keyframes_checked);
    row.Int(static_cast<int64_t>(joined->revision)).Int(joined->joined_unix_ns);
  } else {
    for (int i = 0; i < 17; ++i) row.Null();
  }
  row.Int(static_cast<int64_t>(revision));
  return row;
}

absl::Status FromRow(const Statement& row, map::Component* value) {
  if (!ReadId(row, 0, &value->id)) return OutOfRange("id");
  value->session = SessionId();
  if (row.ColumnType(1) != Statement::Type::kNull && !ReadId(row, 1, &value->session)) return OutOfRange("session");
  CAIRN_RETURN_IF_ERROR(ReadSimilarity(row, 2, "world_from_component", &value->world_from_component));
  value->joined.reset();
  if (row.ColumnType(10) == Statement::Type::kNull) return absl::OkStatus();
  map::ComponentJoin joined;
  if (!ReadId(row, 10, &joined.into)) return OutOfRange("joined_into");
  std::optional<Sim3> into_from_component;
  CAIRN_RETURN_IF_ERROR(ReadSimilarity(row, 11, "into_from_component", &into_from_component));
  if (!into_from_component) return OutOfRange("into_from_component_...");
  joined.into_from_component = *into_from_component;
  if (!ReadIdOrNone(row, 19, &joined.keyframe)) return OutOfRange("joined_keyframe");
  if (!ReadIdOrNone(row, 20, &joined.into_keyframe)) return OutOfRange("joined_into_keyframe");
  joined.keyframe_time_ns = row.Int(21);
  if (!ReadInt(row, 22, &joined.matches) || !ReadInt(row, 23, &joined.keyframes_agreeing) ||
      !ReadInt(row, 24, &joined.keyframes_checked)) {
    return OutOfRange("joined_matches, joined_keyframes_...");
  }
  if (!ReadRevision(row, 25, &joined.revision)) return OutOfRange("joined_revision");
  joined.joined_unix_ns = row.Int(26);
  value->joined = joined;
  return absl::OkStatus();
}

// --- loops ---

Row RowOf(const LoopRow& value) {
  const map::ClosedLoop& loop = value.loop;
  Row row;
  row.Int(value.session.value()).Int(value.number).Int(loop.keyframe.value()).Int(loop.keyframe_time_ns);
  row.Int(loop.loop_keyframe.value()).Int(loop.loop_time_ns).Int(loop.matches);
  row.Real(loop.scale).Real(loop.shift).Real(loop.turn_rad).Real(loop.way);
  return row;
}

absl::Status FromRow(const Statement& row, LoopRow* value) {
  map::ClosedLoop& loop = value->loop;
  if (!ReadId(row, 0, &value->session)) return OutOfRange("session");
  if (!ReadInt(row, 1, &value->number)) return OutOfRange("number");
  if (!ReadId(row, 2, &loop.keyframe)) return OutOfRange("keyframe");
  loop.keyframe_time_ns = row.Int(3);
  if (!ReadId(row, 4, &loop.loop_keyframe)) return OutOfRange("loop_keyframe");
  loop.loop_time_ns = row.Int(5);
  if (!ReadInt(row, 6, &loop.matches)) return OutOfRange("matches");
  loop.scale = row.Real(7);
  loop.shift = row.Real(8);
  loop.turn_rad = row.Real(9);
  loop.way = row.Real(10);
  return absl::OkStatus();
}

// --- reported_trajectories ---

Row RowOf(const TrajectoryRow& value) {
  Row row;
  row.Int(value.session.value()).Int(value.trajectory.refined ? 1 : 0).Int(value.trajectory.keyframes);
  row.Int(value.trajectory.collinear).Text(value.trajectory.reason);
  return row;
}

absl::Status FromRow(const Statement& row, TrajectoryRow* value) {
  if (!ReadId(row, 0, &value->session)) return OutOfRange("session");
  value->trajectory.refined = row.Int(1) != 0;
  if (!ReadInt(row, 2, &value->trajectory.keyframes)) return OutOfRange("keyframes");
  if (!ReadInt(row, 3, &value->trajectory.collinear)) return OutOfRange("collinear");
  value->trajectory.reason = std::string(row.Text(4));
  return absl::OkStatus();
}

// --- keyframes ---

Row RowOf(const map::Keyframe& value, Revision revision) {
  Row row;
  row.Int(value.id.value()).Int(value.session.value()).Int(value.camera.value());
  row.Int(value.time_ns).Int(value.frame_index);
  AddPose(value.camera_from_map.rotation(), value.camera_from_map.translation(), &row);
  AddPose(value.camera_from_direct.rotation(), value.camera_from_direct.translation(), &row);
  row.Int(value.direct_segment);
  if (value.parent) {
    row.Int(value.parent.value());
  } else {
    row.Null();
  }
  row.Int(value.component.value()).Int(static_cast<int64_t>(revision));
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
  value->parent = KeyframeId();
  if (row.ColumnType(20) != Statement::Type::kNull && !ReadId(row, 20, &value->parent)) return OutOfRange("parent");
  const bool has_component = row.num_columns() == static_cast<int>(kKeyframesColumns.size());
  if (has_component && !ReadId(row, 21, &value->component)) return OutOfRange("component");
  return absl::OkStatus();
}

// --- points ---

Row RowOf(const PointRow& value, Revision revision) {
  Row row;
  row.Int(value.id.value()).Real(value.position.x()).Real(value.position.y()).Real(value.position.z());
  row.Int(value.reference_keyframe.value()).Int(value.times_visible).Int(value.times_found);
  row.Int(static_cast<int64_t>(revision));
  return row;
}

absl::Status FromRow(const Statement& row, PointRow* value) {
  if (!ReadId(row, 0, &value->id)) return OutOfRange("id");
  value->position = Vector3d(row.Real(1), row.Real(2), row.Real(3));
  if (!value->position.allFinite()) return OutOfRange("x, y, z");
  if (!ReadId(row, 4, &value->reference_keyframe)) return OutOfRange("reference_keyframe");
  if (!ReadInt(row, 5, &value->times_visible)) return OutOfRange("times_visible");
  if (!ReadInt(row, 6, &value->times_found)) return OutOfRange("times_found");
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

// --- changes ---

Row RowOf(const LoggedChange& value) {
  Row row;
  row.Int(static_cast<int64_t>(value.revision)).Text(value.reason).Int(value.committed_unix_ns);
  row.Int(value.keyframes_put).Int(value.keyframes_removed).Int(value.points_put).Int(value.points_removed);
  if (value.session) {
    row.Int(value.session.value());
  } else {
    row.Null();
  }
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
  if (row.num_columns() < static_cast<int>(kChangesColumns.size())) return absl::OkStatus();
  if (row.ColumnType(7) != Statement::Type::kNull && !ReadId(row, 7, &value->session)) return OutOfRange("session");
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
