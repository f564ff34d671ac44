// The tables of a map file and their rows as values of map/entities.h. Columns are listed in docs/map-format.md and in
// tables_columns.cc; rows are turned into values and back in tables_map.cc, tables_sessions.cc and tables_keyframes.cc.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <type_traits>

#include "base/status.h"
#include "map/entities.h"
#include "store/map_store.h"
#include "store/row.h"
#include "store/table_spec.h"

namespace cairn::store {

// With row_checksum as the last column.
extern const TableSpec kMapTable;
extern const TableSpec kCamerasTable;
extern const TableSpec kLensesTable;
extern const TableSpec kSessionsTable;
extern const TableSpec kComponentsTable;
extern const TableSpec kLoopsTable;
extern const TableSpec kTrajectoriesTable;
extern const TableSpec kKeyframesTable;
extern const TableSpec kPointsTable;
extern const TableSpec kCovisibilityTable;
extern const TableSpec kChangesTable;
// With a checksum per blob.
extern const TableSpec kFeaturesTable;
extern const TableSpec kKeyframePointsTable;
extern const TableSpec kVocabularyTable;
extern const TableSpec kTouchedTable;

// The only row of table `map`.
struct MapRow {
  map::MapInfo info;
  std::optional<Sim3> world_from_map;  // of formats before 4
  Revision revision = 0;
  KeyframeId next_keyframe{1};
  PointId next_point{1};
  CameraId next_camera{1};
  SessionId next_session{1};
  ComponentId next_component{1};
  std::int64_t keyframe_count = 0;
  std::int64_t point_count = 0;
  std::int64_t covisibility_count = 0;
  // write_ahead_log.h
  std::string log_token;
  std::string previous_log_token;
  std::int64_t log_schema_cookie = 0;
  Revision info_revision = 0;      // of the last change of `info`
  Revision oldest_delta_base = 0;  // the first revision of which table `touched` still knows what followed
};

// One row of table `lenses`.
struct LensRow {
  CameraId camera;
  LensCorrection lens;
};

// One row of table `loops`; a session's are numbered from 1.
struct LoopRow {
  SessionId session;
  int number = 0;
  map::ClosedLoop loop;
};

// One row of table `reported_trajectories`.
struct TrajectoryRow {
  SessionId session;
  map::ReportedTrajectory trajectory;
};

// One row of table `covisibility`; a < b.
struct EdgeRow {
  KeyframeId a;
  KeyframeId b;
  int shared_points = 0;
};

// A point as it is stored: what depends on its observations is added after reading.
struct PointRow {
  PointId id;
  Vector3d position = Vector3d::Zero();
  KeyframeId reference_keyframe;
  int times_visible = 0;
  int times_found = 0;
};

// What is written. The row refers to texts of the value. `revision`: of the change that puts it.
Row RowOf(const MapRow& value);
Row RowOf(const map::MapCamera& value, Revision revision, std::string* distortion_blob);
Row RowOf(const LensRow& value);
Row RowOf(const map::Session& value, Revision revision);
Row RowOf(const map::Component& value, Revision revision);
Row RowOf(const LoopRow& value);
Row RowOf(const TrajectoryRow& value);
Row RowOf(const map::Keyframe& value, Revision revision);
Row RowOf(const PointRow& value, Revision revision);
Row RowOf(const EdgeRow& value);
Row RowOf(const LoggedChange& value);

// What was read, of any format. DataLoss (without a fault: the caller knows the table and row) if a value is out of its
// range.
absl::Status FromRow(const Statement& row, MapRow* value);
absl::Status FromRow(const Statement& row, map::MapCamera* value);
absl::Status FromRow(const Statement& row, LensRow* value);
absl::Status FromRow(const Statement& row, map::Session* value);
absl::Status FromRow(const Statement& row, map::Component* value);
absl::Status FromRow(const Statement& row, LoopRow* value);
absl::Status FromRow(const Statement& row, TrajectoryRow* value);
absl::Status FromRow(const Statement& row, map::Keyframe* value);
absl::Status FromRow(const Statement& row, EdgeRow* value);
absl::Status FromRow(const Statement& row, LoggedChange* value);
// Of points there are so many that a row is looked at once.
absl::Status FromCells(const Row& row, PointRow* value);

// Reads the current row with its checksum: DataLoss (as of FromRow) if that is wrong, too. `row` is for use again.
template <class Value>
absl::Status ReadChecked(const Statement& rows, Row* row, Value* value) {
  if (!row->ReadWithChecksum(rows)) return absl::DataLossError("wrong checksum");
  if constexpr (std::is_same_v<Value, PointRow>) {
    return FromCells(*row, value);
  } else {
    return FromRow(rows, value);
  }
}

}  // namespace cairn::store
