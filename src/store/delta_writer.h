// Writes a map::Delta into the tables as one transaction, touching only rows whose content changes. What it writes was
// checked by Snapshot::Apply().
#pragma once

#include <map>
#include <memory>
#include <set>

#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"
#include "store/sqlite.h"
#include "store/tables.h"

namespace cairn::store {

class DeltaWriter {
 public:
  // Prepares its statements; the database must outlive it.
  static absl::StatusOr<std::unique_ptr<DeltaWriter>> Prepare(Database* database);

  // `now_unix_ns` goes into the log of changes; 0: none.
  absl::Status Commit(const map::Delta& delta, std::int64_t now_unix_ns);

  // Writes every row that format 4 gave new columns, of a map that is in the tables already. In a transaction of the
  // caller's.
  absl::Status PutUpgraded(const map::Snapshot& map, const std::vector<LoggedChange>& changes, MapRow map_row);

  // Puts changes of the past into the log of changes.
  absl::Status PutHistory(const std::vector<LoggedChange>& changes);

  // From now on changes carry a token of their own, so that the log that holds them is known (write_ahead_log.h).
  absl::Status BeginLog();
  // Likewise, with a token that depends on the content alone.
  absl::Status EndLog();

  // Writes the row of table `map`; for the creation of a map.
  absl::Status PutMapRow(const MapRow& row);
  // The row of table `map`; kDamaged if its checksum is wrong.
  absl::StatusOr<MapRow> ReadMapRow();

 private:
  explicit DeltaWriter(Database* database) : database_(database) {}

  absl::Status Write(const map::Delta& delta, MapRow* map_row);
  absl::Status WriteHeads(const map::Delta& delta);
  absl::Status SetToken(const std::string& token);
  absl::Status PutSession(const map::Session& session);
  absl::Status PutCamera(const map::MapCamera& camera);
  absl::Status PutComponent(const map::Component& component);
  absl::Status RemovePoint(PointId id, MapRow* map_row);
  absl::Status RemoveKeyframe(KeyframeId id, MapRow* map_row);
  absl::Status PutKeyframe(const map::Keyframe& keyframe, MapRow* map_row);
  absl::Status PutFeatures(const map::Keyframe& keyframe);
  absl::Status PutMovedKeypoints(const map::Delta& delta);
  absl::Status PutPointIds(const map::Keyframe& keyframe, bool is_new);
  absl::Status PutEdges(const map::Keyframe& keyframe, MapRow* map_row);
  absl::Status PutPoint(const map::MapPoint& point, MapRow* map_row);
  // Notes the component of a keyframe as touched. Once per keyframe is enough.
  absl::Status TouchComponentOf(KeyframeId id);
  absl::Status LogChange(const map::Delta& delta, std::int64_t now_unix_ns);
  absl::Status LogTouched(const map::Delta& delta);

  Database* database_;
  Revision revision_ = 0;  // of the change that is being written
  std::set<ComponentId> touched_components_;
  std::set<KeyframeId> looked_up_;
  KeyframeId last_looked_up_;  // points of one keyframe often follow each other
  Statement select_map_, put_map_;
  Statement put_camera_, delete_camera_, put_lens_, delete_lens_, put_session_, put_loop_, delete_loops_,
      put_trajectory_, delete_trajectory_, put_component_, delete_component_;
  Statement select_component_of_, put_keyframe_, update_keyframe_, delete_keyframe_;
  Statement put_features_, delete_features_;
  Statement select_point_ids_, put_point_ids_, delete_point_ids_;
  Statement put_point_, update_point_, delete_point_;
  Statement select_edges_, put_edge_, delete_edge_, delete_edges_;
  Statement put_change_, prune_changes_, put_touched_, prune_touched_;
};

}  // namespace cairn::store
