// Writes a map::Delta into the tables as one transaction, touching only rows whose content changes.
#pragma once

#include <memory>

#include "base/status.h"
#include "map/delta.h"
#include "store/sqlite.h"
#include "store/tables.h"

namespace cairn::store {

class DeltaWriter {
 public:
  // Prepares its statements; the database must outlive it.
  static absl::StatusOr<std::unique_ptr<DeltaWriter>> Prepare(Database* database);

  // `now_unix_ns` goes into the log of changes; 0: none.
  absl::Status Commit(const map::Delta& delta, std::int64_t now_unix_ns);

  // Writes the row of table `map`; for the creation of a map.
  absl::Status PutMapRow(const MapRow& row);
  // The row of table `map`; kDamaged if its checksum is wrong.
  absl::StatusOr<MapRow> ReadMapRow();

 private:
  explicit DeltaWriter(Database* database) : database_(database) {}

  absl::Status Write(const map::Delta& delta, MapRow* map_row);
  absl::Status PutSession(const map::Session& session);
  absl::Status PutCamera(const map::MapCamera& camera);
  absl::Status RemoveKeyframe(KeyframeId id, MapRow* map_row);
  absl::Status PutKeyframe(const map::Keyframe& keyframe, MapRow* map_row);
  // Leaves the row alone if it is the same already.
  absl::Status PutKeyframeRow(const map::Keyframe& keyframe, bool is_new);
  absl::Status PutFeatures(const map::Keyframe& keyframe);
  absl::Status PutMovedKeypoints(const map::Delta& delta);
  absl::Status PutPointIds(const map::Keyframe& keyframe, bool is_new);
  absl::Status PutEdges(const map::Keyframe& keyframe, MapRow* map_row);
  absl::Status PutPoint(const map::MapPoint& point, MapRow* map_row);
  absl::Status LogChange(const map::Delta& delta, std::int64_t now_unix_ns);

  Database* database_;
  Statement select_map_, put_map_;
  Statement put_camera_, put_lens_, delete_lens_, put_session_, put_loop_, delete_loops_, put_trajectory_,
      delete_trajectory_;
  Statement select_keyframe_, put_keyframe_, delete_keyframe_;
  Statement put_features_, count_features_, delete_features_;
  Statement select_point_ids_, put_point_ids_, delete_point_ids_;
  Statement put_point_, update_point_, delete_point_;
  Statement select_edges_, put_edge_, delete_edge_, delete_edges_;
  Statement put_change_, prune_changes_;
};

}  // namespace cairn::store
