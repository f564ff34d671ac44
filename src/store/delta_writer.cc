#include "store/delta_writer.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>

#include "store/blobs.h"
#include "store/fault.h"

namespace cairn::store {
namespace {

absl::Status Rejected(const std::string& why) {
  return absl::InvalidArgumentError(absl::StrCat("change rejected: ", why));
}

bool IsSound(const Quaterniond& rotation, const Vector3d& translation) {
  return std::abs(rotation.norm() - 1.0) < 1e-6 && translation.allFinite();
}

bool IsSound(const SE3& pose) { return IsSound(pose.rotation(), pose.translation()); }

absl::Status CheckInfo(const map::MapInfo& before, const map::MapInfo& after) {
  if (after.id != before.id) return Rejected("the id of a map never changes");
  CAIRN_RETURN_IF_ERROR(after.orb.Validate());
  if (const auto& aligned = after.world_from_map) {
    if (!IsSound(aligned->rotation(), aligned->translation()) || !std::isfinite(aligned->scale()) ||
        aligned->scale() <= 0.0) {
      return Rejected("world_from_map is not a similarity transform");
    }
  }
  return absl::OkStatus();
}

absl::Status CheckKeyframe(const map::Keyframe& keyframe) {
  const std::string name = absl::StrCat("keyframe ", keyframe.id.value());
  if (!keyframe.features) return Rejected(name + " has no features");
  const std::size_t n = keyframe.features->features.keypoints.size();
  if (keyframe.features->features.descriptors.size() != n || keyframe.points.size() != n) {
    return Rejected(name + " has not as many descriptors and points as keypoints");
  }
  const std::size_t num_words = keyframe.features->words.size();
  if (num_words != 0 && num_words != n) return Rejected(name + " has not one word per feature");
  if (!IsSound(keyframe.camera_from_map) || !IsSound(keyframe.camera_from_direct)) {
    return Rejected(name + " has a pose that is not a rigid transform");
  }
  return absl::OkStatus();
}

absl::Status CheckPoint(const map::MapPoint& point) {
  const auto rejected = [&](const char* why) { return Rejected(absl::StrCat("point ", point.id.value(), why)); };
  if (!point.position.allFinite()) return rejected(" has no finite position");
  const auto seen = std::find(point.observations.begin(), point.observations.end(), point.reference);
  if (seen == point.observations.end()) return rejected(" refers to an observation that it does not have");
  return absl::OkStatus();
}

// Ascending, so that none comes twice, and below the next free id.
template <class Entity, class IdType>
absl::Status CheckIds(const std::vector<std::shared_ptr<const Entity>>& entities, IdType next, absl::string_view what) {
  IdType last;
  for (const auto& entity : entities) {
    if (!entity || !(last < entity->id) || !(entity->id < next)) {
      return Rejected(absl::StrCat("its ", what, "s are not in ascending order of valid ids"));
    }
    last = entity->id;
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<std::unique_ptr<DeltaWriter>> DeltaWriter::Prepare(Database* database) {
  std::unique_ptr<DeltaWriter> writer(new DeltaWriter(database));
  const std::pair<Statement*, std::string> statements[] = {
      {&writer->select_map_, kMapTable.SelectSql("WHERE id = 1")},
      {&writer->put_map_, kMapTable.UpsertSql()},
      {&writer->put_camera_, kCamerasTable.UpsertSql()},
      {&writer->put_lens_, kLensesTable.UpsertSql()},
      {&writer->delete_lens_, "DELETE FROM lenses WHERE camera = ?"},
      {&writer->put_session_, kSessionsTable.UpsertSql()},
      {&writer->put_loop_, kLoopsTable.UpsertSql()},
      {&writer->delete_loops_, "DELETE FROM loops WHERE session = ?"},
      {&writer->put_trajectory_, kTrajectoriesTable.UpsertSql()},
      {&writer->delete_trajectory_, "DELETE FROM reported_trajectories WHERE session = ?"},
      {&writer->select_keyframe_, kKeyframesTable.SelectSql("WHERE id = ?")},
      {&writer->put_keyframe_, kKeyframesTable.UpsertSql()},
      {&writer->delete_keyframe_, "DELETE FROM keyframes WHERE id = ?"},
      {&writer->put_features_, kFeaturesTable.UpsertSql()},
      {&writer->count_features_, "SELECT feature_count FROM keyframe_features WHERE keyframe = ?"},
      {&writer->delete_features_, "DELETE FROM keyframe_features WHERE keyframe = ?"},
      {&writer->select_point_ids_, "SELECT point_ids FROM keyframe_points WHERE keyframe = ?"},
      {&writer->put_point_ids_, kKeyframePointsTable.UpsertSql()},
      {&writer->delete_point_ids_, "DELETE FROM keyframe_points WHERE keyframe = ?"},
      {&writer->put_point_, kPointsTable.UpsertSql()},
      {&writer->update_point_, kPointsTable.UpdateSql()},
      {&writer->delete_point_, "DELETE FROM points WHERE id = ?"},
      {&writer->select_edges_,
       "SELECT keyframe_b, shared_points FROM covisibility WHERE keyframe_a = ?1 UNION ALL "
       "SELECT keyframe_a, shared_points FROM covisibility WHERE keyframe_b = ?1"},
      {&writer->put_edge_, kCovisibilityTable.UpsertSql()},
      {&writer->delete_edge_, "DELETE FROM covisibility WHERE keyframe_a = ? AND keyframe_b = ?"},
      {&writer->delete_edges_, "DELETE FROM covisibility WHERE keyframe_a = ?1 OR keyframe_b = ?1"},
      {&writer->put_change_, kChangesTable.UpsertSql()},
      {&writer->prune_changes_, "DELETE FROM changes WHERE revision <= ?"},
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
  CAIRN_RETURN_IF_ERROR(LogChange(delta, now_unix_ns));
  return transaction.Commit();
}

absl::Status DeltaWriter::Write(const map::Delta& delta, MapRow* map_row) {
  for (const map::MapCamera& camera : delta.cameras) CAIRN_RETURN_IF_ERROR(PutCamera(camera));
  for (const map::Session& session : delta.sessions) CAIRN_RETURN_IF_ERROR(PutSession(session));
  for (const PointId id : delta.removed_points) {
    CAIRN_RETURN_IF_ERROR(delete_point_.RunWith(id.value()));
    if (database_->Changes() != 1) return Rejected(absl::StrCat("point ", id.value(), " to be removed is not there"));
    --map_row->point_count;
  }
  for (const KeyframeId id : delta.removed_keyframes) CAIRN_RETURN_IF_ERROR(RemoveKeyframe(id, map_row));
  const KeyframeId next_keyframe = std::max(map_row->next_keyframe, delta.next_keyframe);
  const PointId next_point = std::max(map_row->next_point, delta.next_point);
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.keyframes, next_keyframe, "keyframe"));
  CAIRN_RETURN_IF_ERROR(CheckIds(delta.points, next_point, "point"));
  for (const auto& keyframe : delta.keyframes) CAIRN_RETURN_IF_ERROR(PutKeyframe(*keyframe, map_row));
  CAIRN_RETURN_IF_ERROR(PutMovedKeypoints(delta));
  for (const auto& keyframe : delta.keyframes) CAIRN_RETURN_IF_ERROR(PutEdges(*keyframe, map_row));
  for (const auto& point : delta.points) CAIRN_RETURN_IF_ERROR(PutPoint(*point, map_row));

  if (delta.info) {
    CAIRN_RETURN_IF_ERROR(CheckInfo(map_row->info, *delta.info));
    map_row->info = *delta.info;
  }
  map_row->revision = delta.revision();
  map_row->next_keyframe = next_keyframe;
  map_row->next_point = next_point;
  return PutMapRow(*map_row);
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
  if (!camera.id) return Rejected("it holds a camera without an id");
  CAIRN_RETURN_IF_ERROR(Annotate(camera.model.Validate(), "change rejected"));
  CAIRN_RETURN_IF_ERROR(Annotate(Camera::FromPinhole(camera.pinhole).Validate(), "change rejected: pinhole"));
  std::string distortion_blob;
  const Row row = RowOf(camera, &distortion_blob);
  row.BindWithChecksum(&put_camera_);
  CAIRN_RETURN_IF_ERROR(put_camera_.Run());
  CAIRN_RETURN_IF_ERROR(delete_lens_.RunWith(camera.id.value()));
  if (!camera.lens) return absl::OkStatus();
  CAIRN_RETURN_IF_ERROR(Annotate(camera.lens->Validate(), "change rejected"));
  const LensRow lens{camera.id, *camera.lens};
  const Row lens_row = RowOf(lens);
  lens_row.BindWithChecksum(&put_lens_);
  return put_lens_.Run();
}

absl::Status DeltaWriter::PutSession(const map::Session& session) {
  const Row row = RowOf(session);
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

absl::Status DeltaWriter::RemoveKeyframe(KeyframeId id, MapRow* map_row) {
  CAIRN_RETURN_IF_ERROR(delete_edges_.RunWith(id.value()));
  map_row->covisibility_count -= database_->Changes();
  CAIRN_RETURN_IF_ERROR(delete_point_ids_.RunWith(id.value()));
  CAIRN_RETURN_IF_ERROR(delete_features_.RunWith(id.value()));
  CAIRN_RETURN_IF_ERROR(delete_keyframe_.RunWith(id.value()));
  if (database_->Changes() != 1) return Rejected(absl::StrCat("keyframe ", id.value(), " to be removed is not there"));
  --map_row->keyframe_count;
  return absl::OkStatus();
}

absl::Status DeltaWriter::PutKeyframeRow(const map::Keyframe& keyframe, bool is_new) {
  const Row row = RowOf(keyframe);
  if (!is_new) {
    select_keyframe_.Bind(1, static_cast<std::int64_t>(keyframe.id.value()));
    CAIRN_ASSIGN_OR_RETURN(const bool found, select_keyframe_.Step());
    if (!found) {
      return Rejected(absl::StrCat("keyframe ", keyframe.id.value(), " was removed earlier, or never existed"));
    }
    Row stored;
    const bool same = stored.ReadWithChecksum(select_keyframe_) && stored.SameAs(row);
    select_keyframe_.Reset();
    if (same) return absl::OkStatus();
  }
  row.BindWithChecksum(&put_keyframe_);
  return put_keyframe_.Run();
}

absl::Status DeltaWriter::PutKeyframe(const map::Keyframe& keyframe, MapRow* map_row) {
  CAIRN_RETURN_IF_ERROR(CheckKeyframe(keyframe));
  const bool is_new = !(keyframe.id < map_row->next_keyframe);
  CAIRN_RETURN_IF_ERROR(PutKeyframeRow(keyframe, is_new));
  if (is_new) {
    CAIRN_RETURN_IF_ERROR(PutFeatures(keyframe));
    ++map_row->keyframe_count;
  } else {
    count_features_.Bind(1, static_cast<std::int64_t>(keyframe.id.value()));
    CAIRN_ASSIGN_OR_RETURN(const bool found, count_features_.Step());
    const bool same_count = found && count_features_.Int(0) == static_cast<std::int64_t>(keyframe.points.size());
    count_features_.Reset();
    if (!same_count) return Rejected(absl::StrCat("the features of keyframe ", keyframe.id.value(), " changed"));
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
    if (!kept.insert(edge.keyframe).second || edge.keyframe == keyframe.id) {
      return Rejected(absl::StrCat("the neighbours of keyframe ", keyframe.id.value(), " are not distinct"));
    }
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
  CAIRN_RETURN_IF_ERROR(CheckPoint(point));
  const bool is_new = !(point.id < map_row->next_point);
  if (is_new) ++map_row->point_count;
  const PointRow value{point.id, point.position, point.reference.keyframe, point.times_visible, point.times_found};
  const Row row = RowOf(value);
  // Nearly every point of a change is a changed one: to read it first would cost more than to write it.
  Statement& statement = is_new ? put_point_ : update_point_;
  row.BindWithChecksum(&statement);
  CAIRN_RETURN_IF_ERROR(statement.Run());
  if (is_new || database_->Changes() == 1) return absl::OkStatus();
  return Rejected(absl::StrCat("point ", point.id.value(), " was removed earlier, or never existed"));
}

absl::Status DeltaWriter::LogChange(const map::Delta& delta, std::int64_t now_unix_ns) {
  LoggedChange change;
  change.revision = delta.revision();
  change.reason = delta.reason;
  change.committed_unix_ns = now_unix_ns;
  change.keyframes_put = static_cast<std::int64_t>(delta.keyframes.size());
  change.keyframes_removed = static_cast<std::int64_t>(delta.removed_keyframes.size());
  change.points_put = static_cast<std::int64_t>(delta.points.size());
  change.points_removed = static_cast<std::int64_t>(delta.removed_points.size());
  const Row row = RowOf(change);
  row.BindWithChecksum(&put_change_);
  CAIRN_RETURN_IF_ERROR(put_change_.Run());
  return prune_changes_.RunWith(static_cast<std::int64_t>(change.revision) - kMaxLoggedChanges);
}

}  // namespace cairn::store
