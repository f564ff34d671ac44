#include "store/delta_reader.h"

#include <algorithm>
#include <utility>

#include "map/point_completion.h"
#include "store/fault.h"
#include "store/touched_rows.h"

namespace cairn::store {
namespace {

absl::Status Damaged(const TableSpec& table, std::int64_t id, absl::string_view what) {
  return DamagedBy({std::string(table.name), id, std::string(what)});
}

// The row whose key is `id`; false if there is none. Damage is an error.
template <class Value>
absl::StatusOr<bool> ReadRow(const TableSpec& table, std::int64_t id, Statement* select, Value* value) {
  select->Bind(1, id);
  CAIRN_ASSIGN_OR_RETURN(const bool found, select->Step());
  if (!found) return false;
  Row row;
  const absl::Status status = ReadChecked(*select, &row, value);
  select->Reset();
  if (!status.ok()) return Damaged(table, id, status.message());
  return true;
}

}  // namespace

absl::StatusOr<std::optional<map::Delta>> DeltaReader::Read() {
  CAIRN_ASSIGN_OR_RETURN(const std::int64_t format, database_->QueryInt("PRAGMA user_version"));
  if (format < 4) return std::nullopt;
  CAIRN_ASSIGN_OR_RETURN(Statement select_map, database_->Prepare(kMapTable.SelectSql("WHERE id = ?")));
  CAIRN_ASSIGN_OR_RETURN(const bool found, ReadRow(kMapTable, 1, &select_map, &map_row_));
  if (!found) return Damaged(kMapTable, 0, "there is no row");
  const Revision base = base_.revision();
  if (base_.info().id != map_row_.info.id || base > map_row_.revision || base < map_row_.oldest_delta_base) {
    return std::nullopt;
  }
  delta_.base = base;
  delta_.num_changes = map_row_.revision - base;
  delta_.next_keyframe = map_row_.next_keyframe;
  delta_.next_point = map_row_.next_point;
  delta_.next_camera = map_row_.next_camera;
  delta_.next_session = map_row_.next_session;
  delta_.next_component = map_row_.next_component;
  if (delta_.num_changes == 0) return delta_;
  if (map_row_.info_revision > base) delta_.info = map_row_.info;
  CAIRN_ASSIGN_OR_RETURN(num_words_, ReadNumWords(database_));
  CAIRN_RETURN_IF_ERROR(ReadReason());
  CAIRN_RETURN_IF_ERROR(ReadCameras());
  CAIRN_RETURN_IF_ERROR(ReadSessions());
  CAIRN_RETURN_IF_ERROR(ReadComponents());
  CAIRN_RETURN_IF_ERROR(ReadKeyframes());
  CAIRN_RETURN_IF_ERROR(ReadPoints());
  return std::move(delta_);
}

absl::Status DeltaReader::ReadReason() {
  if (delta_.num_changes > 1) delta_.reason = absl::StrCat(delta_.num_changes, " changes");
  CAIRN_ASSIGN_OR_RETURN(Statement rows, database_->Prepare("SELECT reason, session FROM changes WHERE revision > ?"));
  rows.Bind(1, static_cast<std::int64_t>(delta_.base));
  bool first = true;
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
    if (!found) return absl::OkStatus();
    if (delta_.num_changes == 1) delta_.reason = std::string(rows.Text(0));
    const SessionId session(static_cast<std::uint32_t>(rows.Int(1)));
    delta_.session = first || session == delta_.session ? session : SessionId();
    if (!first && !delta_.session) return absl::OkStatus();
    first = false;
  }
}

template <class Value, class Take, class Removed>
absl::Status DeltaReader::ForTouched(const TableSpec& table, std::uint32_t next, Take take, Removed removed) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<std::uint32_t> ids, ReadTouched(database_, table, delta_.base, next));
  CAIRN_ASSIGN_OR_RETURN(Statement select, database_->Prepare(table.SelectSql("WHERE id = ?")));
  for (const std::uint32_t id : ids) {
    Value value;
    CAIRN_ASSIGN_OR_RETURN(const bool found, ReadRow(table, id, &select, &value));
    if (found) {
      CAIRN_RETURN_IF_ERROR(take(std::move(value)));
    } else {
      removed(id);
    }
  }
  return absl::OkStatus();
}

absl::Status DeltaReader::ReadCameras() {
  CAIRN_ASSIGN_OR_RETURN(Statement select_lens, database_->Prepare(kLensesTable.SelectSql("WHERE camera = ?")));
  return ForTouched<map::MapCamera>(
      kCamerasTable, map_row_.next_camera.value(),
      [&](map::MapCamera camera) -> absl::Status {
        LensRow lens;
        CAIRN_ASSIGN_OR_RETURN(const bool found, ReadRow(kLensesTable, camera.id.value(), &select_lens, &lens));
        if (found) camera.lens = lens.lens;
        delta_.cameras.push_back(std::move(camera));
        return absl::OkStatus();
      },
      [&](std::uint32_t id) {
        if (base_.cameras().contains(CameraId(id))) delta_.removed_cameras.push_back(CameraId(id));
      });
}

absl::Status DeltaReader::ReadSessions() {
  CAIRN_ASSIGN_OR_RETURN(Statement select_loops,
                         database_->Prepare(kLoopsTable.SelectSql("WHERE session = ? ORDER BY number")));
  CAIRN_ASSIGN_OR_RETURN(Statement select_trajectory,
                         database_->Prepare(kTrajectoriesTable.SelectSql("WHERE session = ?")));
  return ForTouched<map::Session>(
      kSessionsTable, map_row_.next_session.value(),
      [&](map::Session session) -> absl::Status {
        const std::int64_t id = session.id.value();
        select_loops.Bind(1, id);
        while (true) {
          CAIRN_ASSIGN_OR_RETURN(const bool found, select_loops.Step());
          if (!found) break;
          Row row;
          LoopRow loop;
          const absl::Status status = ReadChecked(select_loops, &row, &loop);
          if (!status.ok()) return Damaged(kLoopsTable, id, status.message());
          session.loops.push_back(loop.loop);
        }
        TrajectoryRow trajectory;
        CAIRN_ASSIGN_OR_RETURN(const bool found, ReadRow(kTrajectoriesTable, id, &select_trajectory, &trajectory));
        if (found) session.trajectory = std::move(trajectory.trajectory);
        delta_.sessions.push_back(std::move(session));
        return absl::OkStatus();
      },
      [](std::uint32_t) {});
}

absl::Status DeltaReader::ReadComponents() {
  return ForTouched<map::Component>(
      kComponentsTable, map_row_.next_component.value(),
      [&](map::Component component) {
        delta_.components.push_back(std::move(component));
        return absl::OkStatus();
      },
      [&](std::uint32_t id) {
        if (base_.components().contains(ComponentId(id))) delta_.removed_components.push_back(ComponentId(id));
      });
}

absl::Status DeltaReader::ReadKeyframes() {
  const std::pair<Statement*, std::string> statements[] = {
      {&select_features_, kFeaturesTable.SelectSql("WHERE keyframe = ?1 AND revision > ?2")},
      {&select_point_ids_, kKeyframePointsTable.SelectSql("WHERE keyframe = ?1 AND revision > ?2")},
      {&select_edges_, absl::StrCat(kCovisibilityTable.SelectSql("WHERE keyframe_a = ?1 UNION ALL "),
                                    kCovisibilityTable.SelectSql("WHERE keyframe_b = ?1"))},
      {&select_children_, "SELECT id FROM keyframes WHERE parent = ? ORDER BY id"},
  };
  for (const auto& [statement, sql] : statements) {
    CAIRN_ASSIGN_OR_RETURN(*statement, database_->Prepare(sql));
  }
  return ForTouched<map::Keyframe>(
      kKeyframesTable, map_row_.next_keyframe.value(),
      [&](map::Keyframe row) -> absl::Status {
        auto keyframe = std::make_shared<map::Keyframe>(std::move(row));
        const map::Keyframe* before = base_.keyframes().Find(keyframe->id);
        CAIRN_RETURN_IF_ERROR(ReadFeatures(keyframe.get(), before));
        CAIRN_RETURN_IF_ERROR(ReadPointIds(keyframe.get(), before));
        CAIRN_RETURN_IF_ERROR(ReadLinks(keyframe.get()));
        delta_.keyframes.push_back(std::move(keyframe));
        return absl::OkStatus();
      },
      [&](std::uint32_t id) {
        if (base_.keyframes().Contains(KeyframeId(id))) delta_.removed_keyframes.push_back(KeyframeId(id));
      });
}

absl::Status DeltaReader::ReadFeatures(map::Keyframe* keyframe, const map::Keyframe* before) {
  const std::int64_t id = keyframe->id.value();
  select_features_.Bind(1, id);
  select_features_.Bind(2, before != nullptr ? static_cast<std::int64_t>(delta_.base) : std::int64_t{-1});
  CAIRN_ASSIGN_OR_RETURN(const bool found, select_features_.Step());
  if (!found) {
    if (before == nullptr) return Damaged(kFeaturesTable, id, "no good row for the keyframe");
    keyframe->features = before->features;
    return absl::OkStatus();
  }
  const auto put = std::find_if(delta_.cameras.begin(), delta_.cameras.end(),
                                [&](const map::MapCamera& camera) { return camera.id == keyframe->camera; });
  const auto known = base_.cameras().find(keyframe->camera);
  if (put == delta_.cameras.end() && known == base_.cameras().end()) {
    return Damaged(kKeyframesTable, id, "its camera is missing");
  }
  auto features =
      FeaturesFromRow(select_features_, put != delta_.cameras.end() ? &put->pinhole : &known->second.pinhole,
                      map_row_.info.orb.num_levels, num_words_);
  select_features_.Reset();
  if (!features.ok()) return Damaged(kFeaturesTable, id, features.status().message());
  auto loaded = std::make_shared<const map::KeyframeFeatures>(*std::move(features));
  const auto& cache = base_.feature_cache();
  if (cache != nullptr) {
    keyframe->features = cache->OnDemand(keyframe->id, std::move(loaded));
  } else {
    keyframe->features = std::move(loaded);
  }
  if (before != nullptr) delta_.moved_keypoints.push_back(keyframe->id);
  return absl::OkStatus();
}

absl::Status DeltaReader::ReadPointIds(map::Keyframe* keyframe, const map::Keyframe* before) {
  const std::int64_t id = keyframe->id.value();
  select_point_ids_.Bind(1, id);
  select_point_ids_.Bind(2, before != nullptr ? static_cast<std::int64_t>(delta_.base) : std::int64_t{-1});
  CAIRN_ASSIGN_OR_RETURN(const bool found, select_point_ids_.Step());
  if (!found) {
    if (before == nullptr) return Damaged(kKeyframePointsTable, id, "no good row for the keyframe");
    keyframe->points = before->points;
    return absl::OkStatus();
  }
  auto ids = PointIdsFromRow(select_point_ids_, keyframe->features.size());
  select_point_ids_.Reset();
  if (!ids.ok()) return Damaged(kKeyframePointsTable, id, ids.status().message());
  keyframe->points = *std::move(ids);
  return absl::OkStatus();
}

absl::Status DeltaReader::ReadLinks(map::Keyframe* keyframe) {
  const std::int64_t id = keyframe->id.value();
  select_edges_.Bind(1, id);
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, select_edges_.Step());
    if (!found) break;
    Row row;
    EdgeRow edge;
    const absl::Status status = ReadChecked(select_edges_, &row, &edge);
    if (!status.ok()) return Damaged(kCovisibilityTable, id, status.message());
    keyframe->covisible.push_back({edge.a == keyframe->id ? edge.b : edge.a, edge.shared_points});
  }
  SortCovisible(keyframe);
  select_children_.Bind(1, id);
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, select_children_.Step());
    if (!found) return absl::OkStatus();
    keyframe->children.push_back(KeyframeId(static_cast<std::uint32_t>(select_children_.Int(0))));
  }
}

absl::Status DeltaReader::ReadPoints() {
  std::vector<std::shared_ptr<map::MapPoint>> points;
  CAIRN_RETURN_IF_ERROR(ForTouched<PointRow>(
      kPointsTable, map_row_.next_point.value(),
      [&](const PointRow& row) {
        points.push_back(std::make_shared<map::MapPoint>());
        SetFromRow(row, points.back().get());
        return absl::OkStatus();
      },
      [&](std::uint32_t id) {
        if (base_.points().Contains(PointId(id))) delta_.removed_points.push_back(PointId(id));
      }));
  const absl::Status completed = map::CompletePoints(base_, map_row_.info.orb, points, &delta_);
  return completed.ok() ? completed : Damaged(kPointsTable, 0, completed.message());
}

}  // namespace cairn::store
