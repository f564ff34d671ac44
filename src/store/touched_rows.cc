#include "store/touched_rows.h"

#include <algorithm>

#include "store/blobs.h"
#include "store/map_reader.h"

namespace cairn::store {
namespace {

template <class IdType>
absl::Status ReadIds(Database* database, const TableSpec& table, Revision since, IdType next,
                     std::vector<IdType>* ids) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<std::uint32_t> touched, ReadTouched(database, table, since, next.value()));
  for (const std::uint32_t id : touched) ids->push_back(IdType(id));
  return absl::OkStatus();
}

// Whether a keyframe's row in a table of its own was put since. Of a keyframe that has been removed it is not known any
// more; who has a view of before still asks.
absl::StatusOr<bool> PutSince(Statement* select, KeyframeId id, Revision since) {
  select->Bind(1, static_cast<std::int64_t>(id.value()));
  CAIRN_ASSIGN_OR_RETURN(const bool found, select->Step());
  const bool put = !found || select->Int(0) > static_cast<std::int64_t>(since);
  select->Reset();
  return put;
}

// The id behind all of a kind that the first `until` revisions have touched.
template <class IdType>
absl::Status ReadFirstNew(Database* database, const TableSpec& table, Revision until, IdType next, IdType* first_new) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<std::uint32_t> touched,
                         ReadTouched(database, table, 0, next.value(), until));
  *first_new = IdType(touched.empty() ? 1 : touched.back() + 1);
  return absl::OkStatus();
}

absl::StatusOr<map::FirstNewIds> ReadFirstNewIds(Database* database, const MapRow& row, Revision until) {
  map::FirstNewIds ids;
  CAIRN_RETURN_IF_ERROR(ReadFirstNew(database, kCamerasTable, until, row.next_camera, &ids.camera));
  CAIRN_RETURN_IF_ERROR(ReadFirstNew(database, kSessionsTable, until, row.next_session, &ids.session));
  CAIRN_RETURN_IF_ERROR(ReadFirstNew(database, kComponentsTable, until, row.next_component, &ids.component));
  CAIRN_RETURN_IF_ERROR(ReadFirstNew(database, kKeyframesTable, until, row.next_keyframe, &ids.keyframe));
  CAIRN_RETURN_IF_ERROR(ReadFirstNew(database, kPointsTable, until, row.next_point, &ids.point));
  return ids;
}

}  // namespace

absl::StatusOr<std::vector<std::uint32_t>> ReadTouched(Database* database, const TableSpec& table, Revision since,
                                                       std::uint32_t next, Revision until) {
  const auto damaged = [](std::int64_t revision, absl::string_view what) {
    return DamagedBy({std::string(kTouchedTable.name), revision, std::string(what)});
  };
  std::vector<std::uint32_t> ids;
  CAIRN_ASSIGN_OR_RETURN(
      Statement rows,
      database->Prepare(
          "SELECT revision, ids_checksum, ids FROM touched WHERE revision > ?1 AND revision <= ?2 AND kind = ?3"));
  rows.Bind(1, static_cast<std::int64_t>(since));
  rows.Bind(2, static_cast<std::int64_t>(until));
  rows.Bind(3, table.name);
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
    if (!found) break;
    const Bytes packed = rows.Blob(2);
    if (rows.Int(1) != BlobChecksum(packed)) return damaged(rows.Int(0), "ids: wrong checksum");
    const absl::Status status = UnpackIdRuns(packed, next, &ids);
    if (!status.ok()) return damaged(rows.Int(0), status.message());
  }
  std::sort(ids.begin(), ids.end());
  ids.erase(std::unique(ids.begin(), ids.end()), ids.end());
  return ids;
}

absl::StatusOr<std::optional<map::ChangedRows>> ReadChangedRows(Database* database, Revision since) {
  CAIRN_ASSIGN_OR_RETURN(const std::int64_t format, database->QueryInt("PRAGMA user_version"));
  if (format < 4) return std::nullopt;
  MapReader reader(database, DamagedBy);
  CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
  const MapRow& row = reader.map_row();
  if (since > row.revision || since < row.oldest_delta_base) return std::nullopt;
  map::ChangedRows rows;
  rows.base = since;
  rows.info = row.info_revision > since;
  // As long as every change is remembered; of ids that are older than what is, it cannot be known.
  if (row.oldest_delta_base == 0) {
    CAIRN_ASSIGN_OR_RETURN(rows.first_new, ReadFirstNewIds(database, row, since));
  }
  CAIRN_RETURN_IF_ERROR(ReadIds(database, kCamerasTable, since, row.next_camera, &rows.cameras));
  CAIRN_RETURN_IF_ERROR(ReadIds(database, kSessionsTable, since, row.next_session, &rows.sessions));
  CAIRN_RETURN_IF_ERROR(ReadIds(database, kComponentsTable, since, row.next_component, &rows.components));
  CAIRN_RETURN_IF_ERROR(ReadIds(database, kPointsTable, since, row.next_point, &rows.points));
  std::vector<KeyframeId> keyframes;
  CAIRN_RETURN_IF_ERROR(ReadIds(database, kKeyframesTable, since, row.next_keyframe, &keyframes));
  CAIRN_ASSIGN_OR_RETURN(Statement features,
                         database->Prepare("SELECT revision FROM keyframe_features WHERE keyframe = ?"));
  CAIRN_ASSIGN_OR_RETURN(Statement points,
                         database->Prepare("SELECT revision FROM keyframe_points WHERE keyframe = ?"));
  for (const KeyframeId id : keyframes) {
    map::ChangedKeyframe& changed = rows.keyframes.emplace_back(map::ChangedKeyframe{id});
    CAIRN_ASSIGN_OR_RETURN(changed.features, PutSince(&features, id, since));
    CAIRN_ASSIGN_OR_RETURN(changed.points, PutSince(&points, id, since));
  }
  return rows;
}

}  // namespace cairn::store
