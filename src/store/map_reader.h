// Reads the tables of a map file back, checking everything on the way.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"
#include "store/map_store.h"
#include "store/sqlite.h"
#include "store/tables.h"

namespace cairn::store {

// Told of everything wrong. An error that it returns ends the reading; with OK the row at fault is left out.
using FindingSink = std::function<absl::Status(const Finding&)>;

// The finding as an error of fault kDamaged.
absl::Status DamagedBy(const Finding& finding);

// Use inside one read transaction, once.
class MapReader {
 public:
  MapReader(Database* database, FindingSink sink) : database_(database), sink_(std::move(sink)) {}

  // Table map.
  absl::Status ReadInfo();
  // Every other table but the vocabulary and the log of changes.
  absl::Status ReadEntities();
  // These two.
  absl::Status CheckVocabulary();
  absl::Status CheckChanges();
  // Puts together what was read. Only if nothing was found wrong so far.
  absl::StatusOr<std::shared_ptr<const map::Snapshot>> Assemble();

  const MapRow& map_row() const { return map_row_; }

 private:
  absl::Status Report(absl::string_view table, std::int64_t id, absl::string_view message);
  // Reads the rows of a table with a row checksum in the order of their keys; `take` keeps one.
  template <class Value, class Take>
  absl::Status ReadTable(const TableSpec& table, Take take);
  // Loops and reported trajectories of the sessions; formats before 2 have none.
  absl::Status ReadLenses();
  absl::Status ReadTrajectories();
  absl::Status ReadFeatures();
  // How many words the vocabulary in the file has; none if that is not known.
  absl::StatusOr<std::optional<std::uint32_t>> ReadNumWords();
  absl::Status ReadPointIds();
  absl::Status CheckCounts();
  absl::Status CheckTree();
  map::Keyframe* FindKeyframe(std::int64_t id);
  absl::Status LinkKeyframes();
  absl::Status LinkPoints();

  Database* database_;
  FindingSink sink_;
  MapRow map_row_;
  map::Delta content_;                                     // but for keyframes and points:
  std::vector<std::shared_ptr<map::Keyframe>> keyframes_;  // ascending
  std::vector<PointRow> points_;                           // ascending
  std::vector<EdgeRow> edges_;
};

}  // namespace cairn::store
