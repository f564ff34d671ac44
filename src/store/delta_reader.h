// Reads what changed since a revision that the caller has in memory: MapStore::ReadDelta for a map file.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "base/status.h"
#include "map/snapshot.h"
#include "store/map_reader.h"
#include "store/sqlite.h"
#include "store/tables.h"

namespace cairn::store {

// Use inside one read transaction, once.
class DeltaReader {
 public:
  DeltaReader(Database* database, const map::Snapshot& base) : database_(database), base_(base) {}

  // Nothing if `base` is too old, or of another map.
  absl::StatusOr<std::optional<map::Delta>> Read();

 private:
  // Calls take(value) for each touched id that has a row, removed(id) for the others.
  template <class Value, class Take, class Removed>
  absl::Status ForTouched(const TableSpec& table, std::uint32_t next, Take take, Removed removed);
  absl::Status ReadReason();
  absl::Status ReadCameras();
  absl::Status ReadSessions();
  absl::Status ReadComponents();
  absl::Status ReadKeyframes();
  absl::Status ReadFeatures(map::Keyframe* keyframe, const map::Keyframe* before);
  absl::Status ReadPointIds(map::Keyframe* keyframe, const map::Keyframe* before);
  absl::Status ReadLinks(map::Keyframe* keyframe);
  absl::Status ReadPoints();

  Database* database_;
  const map::Snapshot& base_;
  MapRow map_row_;
  map::Delta delta_;
  std::optional<std::uint32_t> num_words_;
  Statement select_features_, select_point_ids_, select_edges_, select_children_;
};

}  // namespace cairn::store
