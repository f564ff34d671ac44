// The tables of a map file and their rows as values of map/entities.h. Columns are listed in docs/map-format.md.
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "base/status.h"
#include "map/entities.h"
#include "store/map_store.h"
#include "store/row.h"

namespace cairn::store {

struct TableSpec {
  absl::string_view name;
  std::span<const absl::string_view> columns;  // the key first
  std::size_t num_keys = 1;

  // "SELECT <columns> FROM <name> <rest>"
  std::string SelectSql(absl::string_view rest) const;
  // Inserts the row, or replaces everything but the key where there is one.
  std::string UpsertSql() const;
  // Replaces everything but the key of the row, if there is one.
  std::string UpdateSql() const;
};

// With row_checksum as the last column.
extern const TableSpec kMapTable;
extern const TableSpec kCamerasTable;
extern const TableSpec kLensesTable;
extern const TableSpec kSessionsTable;
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

// The only row of table `map`.
struct MapRow {
  map::MapInfo info;
  Revision revision = 0;
  KeyframeId next_keyframe{1};
  PointId next_point{1};
  std::int64_t keyframe_count = 0;
  std::int64_t point_count = 0;
  std::int64_t covisibility_count = 0;
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

// What is written. The row refers to texts of the value.
Row RowOf(const MapRow& value);
Row RowOf(const map::MapCamera& value, std::string* distortion_blob);
Row RowOf(const LensRow& value);
Row RowOf(const map::Session& value);
Row RowOf(const LoopRow& value);
Row RowOf(const TrajectoryRow& value);
Row RowOf(const map::Keyframe& value);
Row RowOf(const PointRow& value);
Row RowOf(const EdgeRow& value);
Row RowOf(const LoggedChange& value);

// What was read. DataLoss (without a fault: the caller knows the table and row) if a value is out of its range.
absl::Status FromRow(const Statement& row, MapRow* value);
absl::Status FromRow(const Statement& row, map::MapCamera* value);
absl::Status FromRow(const Statement& row, LensRow* value);
absl::Status FromRow(const Statement& row, map::Session* value);
absl::Status FromRow(const Statement& row, LoopRow* value);
absl::Status FromRow(const Statement& row, TrajectoryRow* value);
absl::Status FromRow(const Statement& row, map::Keyframe* value);
absl::Status FromRow(const Statement& row, PointRow* value);
absl::Status FromRow(const Statement& row, EdgeRow* value);
absl::Status FromRow(const Statement& row, LoggedChange* value);

}  // namespace cairn::store
