#include "store/tables.h"

#include <array>
#include <cmath>
#include <limits>

#include "absl/strings/numbers.h"
#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "store/blobs.h"

namespace cairn::store {
namespace {

using std::int64_t;
using StringView = absl::string_view;

constexpr std::array<StringView, 26> kMapColumns = {
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
constexpr std::array<StringView, 17> kCamerasColumns = {
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
    "row_checksum",
};
constexpr std::array<StringView, 5> kLensesColumns = {"camera", "focal_scale", "k1", "k2", "row_checksum"};
constexpr std::array<StringView, 11> kSessionsColumns = {
    "id",      "camera",          "source",        "software_version", "settings_json", "first_ns",
    "last_ns", "started_unix_ns", "ended_unix_ns", "complete",         "row_checksum",
};
constexpr std::array<StringView, 12> kLoopsColumns = {
    "session", "number", "keyframe", "keyframe_time_ns", "loop_keyframe", "loop_time_ns",
    "matches", "scale",  "shift",    "turn_rad",         "way",           "row_checksum",
};
constexpr std::array<StringView, 6> kTrajectoriesColumns = {
    "session", "refined", "keyframes", "collinear", "reason", "row_checksum",
};
constexpr std::array<StringView, 22> kKeyframesColumns = {
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
    "row_checksum",
};
constexpr std::array<StringView, 8> kPointsColumns = {
    "id", "x", "y", "z", "reference_keyframe", "times_visible", "times_found", "row_checksum",
};
constexpr std::array<StringView, 4> kCovisibilityColumns = {
    "keyframe_a",
    "keyframe_b",
    "shared_points",
    "row_checksum",
};
constexpr std::array<StringView, 8> kChangesColumns = {
    "revision",          "reason",     "committed_unix_ns", "keyframes_put",
    "keyframes_removed", "points_put", "points_removed",    "row_checksum",
};
constexpr std::array<StringView, 10> kFeaturesColumns = {
    "keyframe",       "feature_count", "keypoint_layout", "word_bytes", "keypoints_checksum", "descriptors_checksum",
    "words_checksum", "keypoints",     "descriptors",     "words",
};
constexpr std::array<StringView, 3> kKeyframePointsColumns = {"keyframe", "point_ids_checksum", "point_ids"};
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

const TableSpec kMapTable{"map", kMapColumns};
const TableSpec kCamerasTable{"cameras", kCamerasColumns};
const TableSpec kLensesTable{"lenses", kLensesColumns};
const TableSpec kSessionsTable{"sessions", kSessionsColumns};
const TableSpec kLoopsTable{"loops", kLoopsColumns, 2};
const TableSpec kTrajectoriesTable{"reported_trajectories", kTrajectoriesColumns};
const TableSpec kKeyframesTable{"keyframes", kKeyframesColumns};
const TableSpec kPointsTable{"points", kPointsColumns};
const TableSpec kCovisibilityTable{"covisibility", kCovisibilityColumns, 2};
const TableSpec kChangesTable{"changes", kChangesColumns};
const TableSpec kFeaturesTable{"keyframe_features", kFeaturesColumns};
const TableSpec kKeyframePointsTable{"keyframe_points", kKeyframePointsColumns};
const TableSpec kVocabularyTable{"vocabulary", kVocabularyColumns};

std::string TableSpec::SelectSql(StringView rest) const {
  return absl::StrCat("SELECT ", absl::StrJoin(columns, ", "), " FROM ", name, " ", rest);
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
  if (info.world_from_map) {
    row.Real(info.world_from_map->scale());
    AddPose(info.world_from_map->rotation(), info.world_from_map->translation(), &row);
  } else {
    for (int i = 0; i < 8; ++i) row.Null();
  }
  row.Int(static_cast<int64_t>(value.revision)).Int(value.next_keyframe.value()).Int(value.next_point.value());
  row.Int(value.keyframe_count).Int(value.point_count).Int(value.covisibility_count);
  return row;
}

absl::Status FromRow(const Statement& row, MapRow* value) {
  map::MapInfo& info = value->info;
  info.id = std::string(row.Text(1));
  info.name = std::string(row.Text(2));
  info.software_version = std::string(row.Text(3));
  info.created_unix_ns = row.Int(4);
  if (!ReadInt(row, 5, &info.orb.num_features) || !ReadInt(row, 6, &info.orb.num_levels) ||
      !ReadInt(row, 8, &info.orb.fast_threshold) || !ReadInt(row, 9, &info.orb.min_fast_threshold)) {
    return OutOfRange("orb_...");
  }
  info.orb.scale_factor = row.Real(7);
  CAIRN_RETURN_IF_ERROR(info.orb.Validate());
  info.vocabulary_hash = 0;
  if (row.ColumnType(10) != Statement::Type::kNull && !absl::SimpleHexAtoi(row.Text(10), &info.vocabulary_hash)) {
    return OutOfRange("vocabulary_hash");
  }
  info.world_from_map.reset();
  if (row.ColumnType(11) != Statement::Type::kNull) {
    Quaterniond rotation;
    Vector3d translation;
    const double scale = row.Real(11);
    if (!ReadPose(row, 12, &rotation, &translation) || !std::isfinite(scale) || scale <= 0.0) {
      return absl::DataLossError("world_from_map is not a similarity transform");
    }
    info.world_from_map = Sim3::FromUnit(rotation, translation, scale);
  }
  if (row.Int(19) < 0) return OutOfRange("revision");
  value->revision = static_cast<Revision>(row.Int(19));
  if (!ReadId(row, 20, &value->next_keyframe)) return OutOfRange("next_keyframe");
  if (!ReadId(row, 21, &value->next_point)) return OutOfRange("next_point");
  value->keyframe_count = row.Int(22);
  value->point_count = row.Int(23);
  value->covisibility_count = row.Int(24);
  return absl::OkStatus();
}

// --- cameras ---

Row RowOf(const map::MapCamera& value, std::string* distortion_blob) {
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

Row RowOf(const map::Session& value) {
  Row row;
  row.Int(value.id.value()).Int(value.camera.value()).Text(value.source).Text(value.software_version);
  row.Text(value.settings_json).Int(value.first_ns).Int(value.last_ns);
  row.Int(value.started_unix_ns).Int(value.ended_unix_ns).Int(value.complete ? 1 : 0);
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

Row RowOf(const map::Keyframe& value) {
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
  return absl::OkStatus();
}

// --- points ---

Row RowOf(const PointRow& value) {
  Row row;
  row.Int(value.id.value()).Real(value.position.x()).Real(value.position.y()).Real(value.position.z());
  row.Int(value.reference_keyframe.value()).Int(value.times_visible).Int(value.times_found);
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
  return absl::OkStatus();
}

}  // namespace cairn::store
