#include "store/delta_writer.h"

#include <algorithm>
#include <map>
#include <set>
#include <string>

#include "store/blobs.h"
#include "store/fault.h"
#include "store/write_ahead_log.h"

namespace cairn::store {
namespace {

absl::Status Rejected(const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat("change rejected: ", why));
}

template <class IdType>
std::vector<std::uint32_t> Union(std::vector<std::uint32_t> ids, const std::vector<IdType>& removed) {
  for (const IdType id : removed) ids.push_back(id.value());
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  return ids;
}

template <class Entities>
std::vector<std::uint32_t> IdsOf(const Entities& entities) {
  std::vector<std::uint32_t> ids;
  ids.reserve(entities.size());
  for (const auto& entity : entities) {
    if constexpr (requires { entity->id; }) {
      ids.push_back(entity->id.value());
    } else {
      ids.push_back(entity.id.value());
    }
  }
  return ids;
}

}  // namespace

absl::StatusOr<std::unique_ptr<DeltaWriter>> DeltaWriter::Prepare(Database* database) {
  std::unique_ptr<DeltaWriter> writer(new DeltaWriter(database));
  const std::pair<Statement*, std::string> statements[] = {
      {&writer->select_map_, kMapTable.SelectSql("WHERE id = 1")},
      {&writer->put_map_, kMapTable.UpsertSql()},
      {&writer->put_camera_, kCamerasTable.UpsertSql()},
      {&writer->delete_camera_, "DELETE FROM cameras WHERE id = ?"},
      {&writer->put_lens_, kLensesTable.UpsertSql()},
      {&writer->delete_lens_, "DELETE FROM lenses WHERE camera = ?"},
      {&writer->put_session_, kSessionsTable.UpsertSql()},
      {&writer->put_loop_, kLoopsTable.UpsertSql()},
      {&writer->delete_loops_, "DELETE FROM loops WHERE session = ?"},
      {&writer->put_trajectory_, kTrajectoriesTable.UpsertSql()},
      {&writer->delete_trajectory_, "DELETE FROM reported_trajectories WHERE session = ?"},
      {&writer->put_component_, kComponentsTable.UpsertSql()},
      {&writer->delete_component_, "DELETE FROM components WHERE id = ?"},
      {&writer->select_component_of_, "SELECT component FROM keyframes WHERE id = ?"},
      {&writer->put_keyframe_, kKeyframesTable.UpsertSql()},
      {&writer->update_keyframe_, kKeyframesTable.UpdateSql()},
      {&writer->delete_keyframe_, "DELETE FROM keyframes WHERE id = ?"},
      {&writer->put_features_, kFeaturesTable.UpsertSql()},
      {&writer->delete_features_, "DELETE FROM keyframe_features WHERE keyframe = ?"},
      {&writer->select_point_ids_, "SELECT point_ids FROM keyframe_points WHERE keyframe = ?"},
      {&writer->put_point_ids_, kKeyframePointsTable.UpsertSql()},
      {&writer->delete_point_ids_, "DELETE FROM keyframe_points WHERE keyframe = ?"},
      {&writer->put_point_, kPointsTable.UpsertSql()},
      {&writer->update_point_, kPointsTable.UpdateSql()},
      {&writer->delete_point_, "DELETE FROM points WHERE id = ? RETURNING reference_keyframe"},
      {&writer->select_edges_,
       "SELECT keyframe_b, shared_points FROM covisibility WHERE keyframe_a = ?1 UNION ALL "
       "SELECT keyframe_a, shared_points FROM covisibility WHERE keyframe_b = ?1"},
      {&writer->put_edge_, kCovisibilityTable.UpsertSql()},
      {&writer->delete_edge_, "DELETE FROM covisibility WHERE keyframe_a = ? AND keyframe_b = ?"},
      {&writer->delete_edges_, "DELETE FROM covisibility WHERE keyframe_a = ?1 OR keyframe_b = ?1"},
      {&writer->put_change_, kChangesTable.UpsertSql()},
      {&writer->prune_changes_, "DELETE FROM changes WHERE revision <= ?"},
      {&writer->put_touched_, kTouchedTable.UpsertSql()},
      {&writer->prune_touched_, "DELETE FROM touched WHERE revision <= ?"},
  };
  for (const auto& [statement, sql] : statements) {
    CAIRN_ASSIGN_OR_RETURN(*statement, database->Prepare(sql));
  }
  return writer;
}

absl::Status DeltaWriter::Commit(const map::Delta& delta, std::int64_t now_unix_ns) {
  CAIRN_ASSIGN_OR_RETURN(Transaction transaction, Transaction::Begin(database_, Transaction::Kind::kWrite));
  CAIRN_ASSIGN_OR_RETURN(MapRow map_row, ReadMapRow());
  if (delta.base != map_row.revision) {
    return absl::FailedPreconditionError(absl::StrCat("the change starts from revision ", delta.base,
                                                      " but the map in the file is at revision ", map_row.revision));
  }
  CAIRN_RETURN_IF_ERROR(Write(delta, &map_row));
  CAIRN_RETURN_IF_ERROR(LogTouched(delta));
  CAIRN_RETURN_IF_ERROR(LogChange(delta, now_unix_ns));
  return transaction.Commit();
}

absl::Status DeltaWriter::Write(const map::Delta& delta, MapRow* map_row) {
  revision_ = delta.revision();
  touched_components_.clear();
  looked_up_.clear();
  last_looked_up_ = KeyframeId();
  CAIRN_RETURN_IF_ERROR(WriteHeads(delta));
  for (const PointId id : delta.removed_points) CAIRN_RETURN_IF_ERROR(RemovePoint(id, map_row));
  for (const KeyframeId id : delta.removed_keyframes) CAIRN_RETURN_IF_ERROR(RemoveKeyframe(id, map_row));
  for (const auto& keyframe : delta.keyframes) CAIRN_RETURN_IF_ERROR(PutKeyframe(*keyframe, map_row));
  CAIRN_RETURN_IF_ERROR(PutMovedKeypoints(delta));
  for (const auto& keyframe : delta.keyframes) CAIRN_RETURN_IF_ERROR(PutEdges(*keyframe, map_row));
  for (const auto& point : delta.points) CAIRN_RETURN_IF_ERROR(PutPoint(*point, map_row));
  // Keyframes may have left them in this change.
  for (const ComponentId id : delta.removed_components) CAIRN_RETURN_IF_ERROR(delete_component_.RunWith(id.value()));
  for (const CameraId id : delta.removed_cameras) {
    CAIRN_RETURN_IF_ERROR(delete_lens_.RunWith(id.value()));
    CAIRN_RETURN_IF_ERROR(delete_camera_.RunWith(id.value()));
  }

  if (delta.info) {
    map_row->info = *delta.info;
    map_row->info_revision = revision_;
  }
  map_row->revision = revision_;
  map_row->next_keyframe = std::max(map_row->next_keyframe, delta.next_keyframe);
  map_row->next_point = std::max(map_row->next_point, delta.next_point);
  map_row->next_camera = std::max(map_row->next_camera, delta.next_camera);
  map_row->next_session = std::max(map_row->next_session, delta.next_session);
  map_row->next_component = std::max(map_row->next_component, delta.next_component);
  if (revision_ > kMaxDeltaRevisions) {
    map_row->oldest_delta_base = std::max(map_row->oldest_delta_base, revision_ - kMaxDeltaRevisions);
  }
  return PutMapRow(*map_row);
}

absl::Status DeltaWriter::WriteHeads(const map::Delta& delta) {
  for (const map::MapCamera& camera : delta.cameras) CAIRN_RETURN_IF_ERROR(PutCamera(camera));
  for (const map::Session& session : delta.sessions) CAIRN_RETURN_IF_ERROR(PutSession(session));
  for (const map::Component& component : delta.components) {
    CAIRN_RETURN_IF_ERROR(PutComponent(component));
    touched_components_.insert(component.id);
  }
  touched_components_.insert(delta.removed_components.begin(), delta.removed_components.end());
  return absl::OkStatus();
}

absl::Status DeltaWriter::PutUpgraded(const map::Snapshot& map, const std::vector<LoggedChange>& changes,
                                      MapRow map_row) {
  revision_ = map.revision();
  absl::Status status;
  const auto keep = [&status](const absl::Status& put) { status.Update(put); };
  for (const auto& [id, camera] : map.cameras()) keep(PutCamera(camera));
  for (const auto& [id, session] : map.sessions()) keep(PutSession(session));
  for (const auto& [id, component] : map.components()) keep(PutComponent(component));
  map.keyframes().ForEach([&](const auto& keyframe) {
    const Row row = RowOf(*keyframe, revision_);
    row.BindWithChecksum(&update_keyframe_);
    if (status.ok()) keep(update_keyframe_.Run());
  });
  map.points().ForEach([&](const auto& point) {
    if (status.ok()) keep(PutPoint(*point, &map_row));
  });
  keep(PutHistory(changes));
  CAIRN_RETURN_IF_ERROR(status);
  map_row.info = map.info();
  map_row.info_revision = revision_;
  map_row.next_camera = map.next_camera();
  map_row.next_session = map.next_session();
  map_row.next_component = map.next_component();
  map_row.oldest_delta_base = revision_;
  return PutMapRow(map_row);
}

absl::Status DeltaWriter::PutHistory(const std::vector<LoggedChange>& changes) {
  for (const LoggedChange& change : changes) {
    const Row row = RowOf(change);
    row.BindWithChecksum(&put_change_);
    CAIRN_RETURN_IF_ERROR(put_change_.Run());
  }
  return absl::OkStatus();
}

absl::Status DeltaWriter::BeginLog() { return SetToken(NewLogToken()); }

absl::Status DeltaWriter::EndLog() {
  CAIRN_ASSIGN_OR_RETURN(const MapRow map_row, ReadMapRow());
  return SetToken(absl::StrCat("closed-", map_row.revision));
}

absl::Status DeltaWriter::SetToken(const std::string& token) {
  CAIRN_ASSIGN_OR_RETURN(Transaction transaction, Transaction::Begin(database_, Transaction::Kind::kWrite));
  CAIRN_ASSIGN_OR_RETURN(MapRow map_row, ReadMapRow());
  map_row.previous_log_token = map_row.log_token;
  map_row.log_token = token;
  CAIRN_ASSIGN_OR_RETURN(map_row.log_schema_cookie, database_->QueryInt("PRAGMA schema_version"));
  CAIRN_RETURN_IF_ERROR(PutMapRow(map_row));
  return transaction.Commit();
}

absl::Status DeltaWriter::PutMapRow(const MapRow& map_row) {
  const Row row = RowOf(map_row);
  row.BindWithChecksum(&put_map_);
  return put_map_.Run();
}

absl::StatusOr<MapRow> DeltaWriter::ReadMapRow() {
  CAIRN_ASSIGN_OR_RETURN(const bool found, select_map_.Step());
  if (!found) return MakeFault(Fault::kDamaged, "the file is damaged: table map has no row");
  Row row;
  MapRow map_row;
  absl::Status status;
  if (!row.ReadWithChecksum(select_map_)) {
    status = absl::DataLossError("wrong checksum");
  } else {
    status = FromRow(select_map_, &map_row);
  }
  select_map_.Reset();
  if (!status.ok()) {
    return MakeFault(Fault::kDamaged, absl::StrCat("the file is damaged: table map: ", status.message()));
  }
  return map_row;
}

absl::Status DeltaWriter::PutCamera(const map::MapCamera& camera) {
  std::string distortion_blob;
  const Row row = RowOf(camera, revision_, &distortion_blob);
  row.BindWithChecksum(&put_camera_);
  CAIRN_RETURN_IF_ERROR(put_camera_.Run());
  CAIRN_RETURN_IF_ERROR(delete_lens_.RunWith(camera.id.value()));
  if (!camera.lens) return absl::OkStatus();
  const LensRow lens{camera.id, *camera.lens};
  const Row lens_row = RowOf(lens);
  lens_row.BindWithChecksum(&put_lens_);
  return put_lens_.Run();
}

absl::Status DeltaWriter::PutComponent(const map::Component& component) {
  const Row row = RowOf(component, revision_);
  row.BindWithChecksum(&put_component_);
  return put_component_.Run();
}

absl::Status DeltaWriter::PutSession(const map::Session& session) {
  const Row row = RowOf(session, revision_);
  row.BindWithChecksum(&put_session_);
  CAIRN_RETURN_IF_ERROR(put_session_.Run());
  CAIRN_RETURN_IF_ERROR(delete_loops_.RunWith(session.id.value()));
  int number = 0;
  for (const map::ClosedLoop& loop : session.loops) {
    const Row loop_row = RowOf(LoopRow{session.id, ++number, loop});
    loop_row.BindWithChecksum(&put_loop_);
    CAIRN_RETURN_IF_ERROR(put_loop_.Run());
  }
  CAIRN_RETURN_IF_ERROR(delete_trajectory_.RunWith(session.id.value()));
  if (!session.trajectory) return absl::OkStatus();
  const TrajectoryRow trajectory{session.id, *session.trajectory};
  const Row trajectory_row = RowOf(trajectory);
  trajectory_row.BindWithChecksum(&put_trajectory_);
  return put_trajectory_.Run();
}

absl::Status DeltaWriter::RemovePoint(PointId id, MapRow* map_row) {
  delete_point_.Bind(1, static_cast<std::int64_t>(id.value()));
  CAIRN_ASSIGN_OR_RETURN(const bool found, delete_point_.Step());
  if (!found) return Rejected(absl::StrCat("point ", id.value(), " to be removed is not there"));
  const KeyframeId reference(static_cast<std::uint32_t>(delete_point_.Int(0)));
  CAIRN_RETURN_IF_ERROR(delete_point_.Run());
  --map_row->point_count;
  return TouchComponentOf(reference);
}

absl::Status DeltaWriter::RemoveKeyframe(KeyframeId id, MapRow* map_row) {
  CAIRN_RETURN_IF_ERROR(TouchComponentOf(id));
  CAIRN_RETURN_IF_ERROR(delete_edges_.RunWith(id.value()));
  map_row->covisibility_count -= database_->Changes();
  CAIRN_RETURN_IF_ERROR(delete_point_ids_.RunWith(id.value()));
  CAIRN_RETURN_IF_ERROR(delete_features_.RunWith(id.value()));
  CAIRN_RETURN_IF_ERROR(delete_keyframe_.RunWith(id.value()));
  if (database_->Changes() != 1) return Rejected(absl::StrCat("keyframe ", id.value(), " to be removed is not there"));
  --map_row->keyframe_count;
  return absl::OkStatus();
}

absl::Status DeltaWriter::TouchComponentOf(KeyframeId id) {
  if (id == last_looked_up_) return absl::OkStatus();
  last_looked_up_ = id;
  if (!looked_up_.insert(id).second) return absl::OkStatus();
  select_component_of_.Bind(1, static_cast<std::int64_t>(id.value()));
  CAIRN_ASSIGN_OR_RETURN(const bool found, select_component_of_.Step());
  if (found) touched_components_.insert(ComponentId(static_cast<std::uint32_t>(select_component_of_.Int(0))));
  select_component_of_.Reset();
  return absl::OkStatus();
}

absl::Status DeltaWriter::PutKeyframe(const map::Keyframe& keyframe, MapRow* map_row) {
  const bool is_new = !(keyframe.id < map_row->next_keyframe);
  const Row row = RowOf(keyframe, revision_);
  Statement& statement = is_new ? put_keyframe_ : update_keyframe_;
  row.BindWithChecksum(&statement);
  CAIRN_RETURN_IF_ERROR(statement.Run());
  touched_components_.insert(keyframe.component);
  looked_up_.insert(keyframe.id);
  if (is_new) {
    CAIRN_RETURN_IF_ERROR(PutFeatures(keyframe));
    ++map_row->keyframe_count;
  } else if (database_->Changes() != 1) {
    return Rejected(absl::StrCat("keyframe ", keyframe.id.value(), " was removed earlier, or never existed"));
  }
  return PutPointIds(keyframe, is_new);
}

absl::Status DeltaWriter::PutFeatures(const map::Keyframe& keyframe) {
  const PackedFeatures packed = PackFeatures(*keyframe.features);
  int parameter = 0;
  for (const std::int64_t value :
       {static_cast<std::int64_t>(keyframe.id.value()), static_cast<std::int64_t>(packed.count),
        static_cast<std::int64_t>(packed.layout), static_cast<std::int64_t>(packed.word_bytes),
        BlobChecksum(AsBytes(packed.keypoints)), BlobChecksum(AsBytes(packed.descriptors)),
        BlobChecksum(AsBytes(packed.words))}) {
    put_features_.Bind(++parameter, value);
  }
  put_features_.Bind(++parameter, AsBytes(packed.keypoints));
  put_features_.Bind(++parameter, AsBytes(packed.descriptors));
  put_features_.Bind(++parameter, AsBytes(packed.words));
  put_features_.Bind(++parameter, static_cast<std::int64_t>(revision_));
  return put_features_.Run();
}

absl::Status DeltaWriter::PutMovedKeypoints(const map::Delta& delta) {
  auto next = delta.keyframes.begin();
  for (const KeyframeId id : delta.moved_keypoints) {
    while (next != delta.keyframes.end() && (*next)->id < id) ++next;
    if (next == delta.keyframes.end() || (*next)->id != id) {
      return Rejected(
          absl::StrCat("the keypoints of keyframe ", id.value(), " moved, but it is not among the changed"));
    }
    CAIRN_RETURN_IF_ERROR(PutFeatures(**next));
  }
  return absl::OkStatus();
}

absl::Status DeltaWriter::PutPointIds(const map::Keyframe& keyframe, bool is_new) {
  const std::string packed = PackPointIds(keyframe.points);
  if (!is_new) {
    select_point_ids_.Bind(1, static_cast<std::int64_t>(keyframe.id.value()));
    CAIRN_ASSIGN_OR_RETURN(const bool found, select_point_ids_.Step());
    const Bytes stored = found ? select_point_ids_.Blob(0) : Bytes();
    const bool same = found && std::equal(stored.begin(), stored.end(), AsBytes(packed).begin(), AsBytes(packed).end());
    select_point_ids_.Reset();
    if (same) return absl::OkStatus();
  }
  put_point_ids_.Bind(1, static_cast<std::int64_t>(keyframe.id.value()));
  put_point_ids_.Bind(2, BlobChecksum(AsBytes(packed)));
  put_point_ids_.Bind(3, AsBytes(packed));
  put_point_ids_.Bind(4, static_cast<std::int64_t>(revision_));
  return put_point_ids_.Run();
}

absl::Status DeltaWriter::PutEdges(const map::Keyframe& keyframe, MapRow* map_row) {
  std::map<KeyframeId, int> stored;
  select_edges_.Bind(1, static_cast<std::int64_t>(keyframe.id.value()));
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, select_edges_.Step());
    if (!found) break;
    stored.emplace(KeyframeId(static_cast<std::uint32_t>(select_edges_.Int(0))),
                   static_cast<int>(select_edges_.Int(1)));
  }
  std::set<KeyframeId> kept;
  for (const map::CovisibilityEdge& edge : keyframe.covisible) {
    kept.insert(edge.keyframe);
    const auto known = stored.find(edge.keyframe);
    if (known != stored.end() && known->second == edge.shared_points) continue;
    if (known == stored.end()) ++map_row->covisibility_count;
    const EdgeRow value{std::min(keyframe.id, edge.keyframe), std::max(keyframe.id, edge.keyframe), edge.shared_points};
    const Row row = RowOf(value);
    row.BindWithChecksum(&put_edge_);
    CAIRN_RETURN_IF_ERROR(put_edge_.Run());
  }
  for (const auto& [other, shared_points] : stored) {
    if (kept.contains(other)) continue;
    CAIRN_RETURN_IF_ERROR(
        delete_edge_.RunWith(std::min(keyframe.id, other).value(), std::max(keyframe.id, other).value()));
    --map_row->covisibility_count;
  }
  return absl::OkStatus();
}

absl::Status DeltaWriter::PutPoint(const map::MapPoint& point, MapRow* map_row) {
  CAIRN_RETURN_IF_ERROR(TouchComponentOf(point.reference.keyframe));
  const bool is_new = !(point.id < map_row->next_point);
  if (is_new) ++map_row->point_count;
  const PointRow value{point.id, point.position, point.reference.keyframe, point.times_visible, point.times_found};
  const Row row = RowOf(value, revision_);
  // Nearly every point of a change is a changed one: to read it first would cost more than to write it.
  Statement& statement = is_new ? put_point_ : update_point_;
  row.BindWithChecksum(&statement);
  CAIRN_RETURN_IF_ERROR(statement.Run());
  if (is_new || database_->Changes() == 1) return absl::OkStatus();
  return Rejected(absl::StrCat("point ", point.id.value(), " was removed earlier, or never existed"));
}

absl::Status DeltaWriter::LogChange(const map::Delta& delta, std::int64_t now_unix_ns) {
  LoggedChange change;
  change.revision = revision_;
  change.reason = delta.reason;
  change.session = delta.session;
  change.committed_unix_ns = now_unix_ns;
  change.components.assign(touched_components_.begin(), touched_components_.end());
  const auto count = [](const auto& entities) { return static_cast<std::int64_t>(entities.size()); };
  change.keyframes_put = count(delta.keyframes);
  change.keyframes_removed = count(delta.removed_keyframes);
  change.points_put = count(delta.points);
  change.points_removed = count(delta.removed_points);
  change.cameras_put = count(delta.cameras);
  change.cameras_removed = count(delta.removed_cameras);
  change.sessions_put = count(delta.sessions);
  change.components_put = count(delta.components);
  change.components_removed = count(delta.removed_components);
  change.info_put = delta.info.has_value();
  const Row row = RowOf(change);
  row.BindWithChecksum(&put_change_);
  CAIRN_RETURN_IF_ERROR(put_change_.Run());
  return prune_changes_.RunWith(static_cast<std::int64_t>(revision_) - kMaxLoggedChanges);
}

absl::Status DeltaWriter::LogTouched(const map::Delta& delta) {
  const std::pair<absl::string_view, std::vector<std::uint32_t>> kinds[] = {
      {kCamerasTable.name, Union(IdsOf(delta.cameras), delta.removed_cameras)},
      {kSessionsTable.name, IdsOf(delta.sessions)},
      {kComponentsTable.name, Union(IdsOf(delta.components), delta.removed_components)},
      {kKeyframesTable.name, Union(IdsOf(delta.keyframes), delta.removed_keyframes)},
      {kPointsTable.name, Union(IdsOf(delta.points), delta.removed_points)},
  };
  for (const auto& [kind, ids] : kinds) {
    if (ids.empty()) continue;
    const std::string packed = PackIdRuns(ids);
    put_touched_.Bind(1, static_cast<std::int64_t>(revision_));
    put_touched_.Bind(2, kind);
    put_touched_.Bind(3, BlobChecksum(AsBytes(packed)));
    put_touched_.Bind(4, AsBytes(packed));
    CAIRN_RETURN_IF_ERROR(put_touched_.Run());
  }
  return prune_touched_.RunWith(static_cast<std::int64_t>(revision_) - static_cast<std::int64_t>(kMaxDeltaRevisions));
}

}  // namespace cairn::store
