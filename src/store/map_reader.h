// Reads the tables of a map file back, checking everything on the way.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"
#include "store/blobs.h"
#include "store/map_assembly.h"
#include "store/map_store.h"
#include "store/ready_summary.h"
#include "store/sqlite.h"
#include "store/tables.h"

namespace cairn::store {

// The finding as an error of fault kDamaged.
absl::Status DamagedBy(const Finding& finding);

// The features of the current row of table `keyframe_features`, of a keyframe of `camera` (null: not known). DataLoss
// (without a fault) that says what is wrong: a checksum, or values that are read by number or cast to one later.
absl::StatusOr<map::KeyframeFeatures> FeaturesFromRow(const Statement& row, const Pinhole* camera, int num_levels,
                                                      std::optional<std::uint32_t> num_words);
// The same without unpacking all of them; words are not looked at. Refers to the row.
absl::StatusOr<FeatureBlobs> FeatureBlobsFromRow(const Statement& row, const Pinhole* camera, int num_levels);
// Likewise the points of the current row of table `keyframe_points`.
absl::StatusOr<std::vector<PointId>> PointIdsFromRow(const Statement& row, std::size_t num_features);
// Those rows of table `changes` that are selected, in that order.
absl::StatusOr<std::vector<LoggedChange>> ReadLog(Statement rows);
// How many words the vocabulary in the file has; none if that is not known.
absl::StatusOr<std::optional<std::uint32_t>> ReadNumWords(Database* database);

// What becomes of features while a map is read.
struct FeatureUse {
  map::FeatureCache* on_demand = nullptr;  // the features of keyframes are read and checked, but not kept; null: kept
  std::function<absl::Status(KeyframeId keyframe, const std::vector<std::uint32_t>& words)> words = {};
};

// Use inside one read transaction, once.
class MapReader {
 public:
  MapReader(Database* database, FindingSink sink) : database_(database), sink_(std::move(sink)) {}

  // The format, and table map.
  absl::Status ReadInfo();
  // Cameras with their lenses, sessions with their loops and trajectories, components: what is few whatever the size of
  // the map. Is part of ReadEntities().
  absl::Status ReadDescription();
  // Every other table but the vocabulary and the log of changes.
  absl::Status ReadEntities(const FeatureUse& use = {});
  // These two.
  absl::Status CheckVocabulary();
  absl::Status CheckChanges();
  // Puts together what was read. Only if nothing was found wrong so far.
  absl::StatusOr<std::shared_ptr<const map::Snapshot>> Assemble();

  const MapRow& map_row() const { return rows_.map_row; }
  // After ReadDescription(): no keyframes and points are in it.
  const map::Delta& content() const { return rows_.content; }
  std::int64_t format() const { return rows_.format; }
  // What was read, instead of Assemble().
  MapRows TakeRows() { return std::move(rows_); }

 private:
  absl::Status Report(absl::string_view table, std::int64_t id, absl::string_view message);
  // Gives `use` each row of a table, with its key, in the order of the keys, and ends with its error.
  template <class Use>
  absl::Status ForEachRow(const TableSpec& table, Use use);
  // The same for a table with a row checksum; `take` keeps a value.
  template <class Value, class Take>
  absl::Status ReadTable(const TableSpec& table, Take take);
  // Formats before 3 have none.
  absl::Status ReadLenses();
  // Loops and reported trajectories of the sessions; formats before 2 have none.
  absl::Status ReadTrajectories();
  absl::Status CheckTouched();
  absl::Status CheckRowCounts(Counted which);
  absl::Status ReadFeatures(const FeatureUse& use);
  absl::Status ReadPointIds(bool features_come_later);
  // Of the points whose descriptor comes from this keyframe, whose features are not kept.
  void SetAnchors(const map::Keyframe& keyframe, const FeatureBlobs& features, const IdIndex& index,
                  const std::vector<KeyframeId>& reference_of);
  absl::Status CheckCounts();

  Database* database_;
  FindingSink sink_;
  MapRows rows_;
};

}  // namespace cairn::store
