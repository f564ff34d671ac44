// Rows of the tables about what made the map: cameras and their lenses, sessions with their loops and trajectories,
// components.
#include <algorithm>
#include <initializer_list>
#include <optional>
#include <string>

#include "store/blobs.h"
#include "store/row_values.h"
#include "store/tables.h"

namespace cairn::store {
namespace {

// The enumerator of that name.
template <class Enum>
bool FindNamed(std::initializer_list<Enum> all, const char* (*name_of)(Enum), absl::string_view name, Enum* value) {
  const auto found = std::find_if(all.begin(), all.end(), [&](Enum one) { return name == name_of(one); });
  if (found == all.end()) return false;
  *value = *found;
  return true;
}

}  // namespace

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
  row.Int(static_cast<std::int64_t>(revision));
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
  row.TextCopy(IdList(value.components)).Int(static_cast<std::int64_t>(revision));
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
  if (!kSessionsTable.IsNewest(row)) {
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
  AddIdOrNull(value.session, &row);
  AddSimilarity(value.world_from_component, &row);
  if (const auto& joined = value.joined) {
    row.Int(joined->into.value());
    AddSimilarity(joined->into_from_component, &row);
    row.Int(joined->keyframe.value()).Int(joined->into_keyframe.value()).Int(joined->keyframe_time_ns);
    row.Int(joined->matches).Int(joined->keyframes_agreeing).Int(joined->keyframes_checked);
    row.Int(static_cast<std::int64_t>(joined->revision)).Int(joined->joined_unix_ns);
  } else {
    for (int i = 0; i < 17; ++i) row.Null();
  }
  row.Int(static_cast<std::int64_t>(revision));
  return row;
}

absl::Status FromRow(const Statement& row, map::Component* value) {
  if (!ReadId(row, 0, &value->id)) return OutOfRange("id");
  if (!ReadIdOrNull(row, 1, &value->session)) return OutOfRange("session");
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

}  // namespace cairn::store
