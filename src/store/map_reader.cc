#include "store/map_reader.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <unordered_map>
#include <utility>

#include "map/component_assignment.h"
#include "map/viewing.h"
#include "store/blobs.h"
#include "store/fault.h"

namespace cairn::store {
namespace {

std::string Describe(const Finding& finding) {
  if (finding.table.empty()) return finding.message;
  if (finding.id == 0) return absl::StrCat("table ", finding.table, ": ", finding.message);
  return absl::StrCat("table ", finding.table, " row ", finding.id, ": ", finding.message);
}

}  // namespace

absl::Status DamagedBy(const Finding& finding) {
  return MakeFault(Fault::kDamaged, absl::StrCat("the file is damaged: ", Describe(finding)));
}

absl::StatusOr<map::KeyframeFeatures> FeaturesFromRow(const Statement& row, const Pinhole& camera, int num_levels,
                                                      std::optional<std::uint32_t> num_words) {
  const Bytes keypoints = row.Blob(7), descriptors = row.Blob(8), words = row.Blob(9);
  if (row.Int(4) != BlobChecksum(keypoints)) return absl::DataLossError("keypoints: wrong checksum");
  if (row.Int(5) != BlobChecksum(descriptors)) return absl::DataLossError("descriptors: wrong checksum");
  if (row.Int(6) != BlobChecksum(words)) return absl::DataLossError("words: wrong checksum");
  CAIRN_ASSIGN_OR_RETURN(auto features,
                         UnpackFeatures(row.Int(1), row.Int(2), row.Int(3), keypoints, descriptors, words));
  const absl::string_view wrong = WrongFeatures(features, camera, num_levels, num_words);
  if (!wrong.empty()) return absl::DataLossError(wrong);
  return features;
}

absl::StatusOr<std::vector<PointId>> PointIdsFromRow(const Statement& row, std::size_t num_features) {
  const Bytes packed = row.Blob(2);
  if (row.Int(1) != BlobChecksum(packed)) return absl::DataLossError("point_ids: wrong checksum");
  return UnpackPointIds(num_features, packed);
}

absl::StatusOr<std::vector<LoggedChange>> ReadLog(Statement rows) {
  std::vector<LoggedChange> changes;
  Row row;
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
    if (!found) return changes;
    if (!row.ReadWithChecksum(rows)) return DamagedBy({"changes", rows.Int(0), "wrong checksum"});
    CAIRN_RETURN_IF_ERROR(FromRow(rows, &changes.emplace_back()));
  }
}

absl::StatusOr<std::optional<std::uint32_t>> ReadNumWords(Database* database) {
  // docs/vocabulary.md, "File format".
  constexpr absl::string_view kMagic = "CAIRNVOC";
  constexpr std::size_t kNumWordsAt = 24;
  CAIRN_ASSIGN_OR_RETURN(Statement rows, database->Prepare("SELECT substr(bytes, 1, 28) FROM vocabulary"));
  const absl::StatusOr<bool> found = rows.Step();
  if (!found.ok() && !IsDamaged(found.status())) return found.status();
  if (!found.ok() || !*found) return std::optional<std::uint32_t>();
  const Bytes start = rows.Blob(0);
  std::uint32_t num_words = 0;
  if (start.size() < kNumWordsAt + sizeof(num_words) || std::memcmp(start.data(), kMagic.data(), kMagic.size()) != 0) {
    return std::optional<std::uint32_t>();
  }
  std::memcpy(&num_words, start.data() + kNumWordsAt, sizeof(num_words));
  return num_words;
}

void SortCovisible(map::Keyframe* keyframe) {
  std::sort(keyframe->covisible.begin(), keyframe->covisible.end(), [](const auto& a, const auto& b) {
    return a.shared_points != b.shared_points ? a.shared_points > b.shared_points : a.keyframe < b.keyframe;
  });
}

absl::Status MapReader::Report(absl::string_view table, std::int64_t id, absl::string_view message) {
  return sink_(Finding{std::string(table), id, std::string(message)});
}

template <class Use>
absl::Status MapReader::ForEachRow(const TableSpec& table, Use use) {
  CAIRN_ASSIGN_OR_RETURN(Statement rows,
                         database_->Prepare(table.SelectSql(absl::StrCat("ORDER BY ", table.columns[0]), format_)));
  while (true) {
    const absl::StatusOr<bool> found = rows.Step();
    if (!found.ok()) {
      // Damaged pages: what comes after cannot be read.
      if (!IsDamaged(found.status())) return found.status();
      return Report(table.name, 0, found.status().message());
    }
    if (!*found) return absl::OkStatus();
    CAIRN_RETURN_IF_ERROR(use(rows, rows.Int(0)));
  }
}

template <class Value, class Take>
absl::Status MapReader::ReadTable(const TableSpec& table, Take take) {
  Row row;
  return ForEachRow(table, [&](const Statement& rows, std::int64_t id) -> absl::Status {
    Value value;
    if (!row.ReadWithChecksum(rows)) return Report(table.name, id, "wrong checksum");
    if (const absl::Status status = FromRow(rows, &value); !status.ok())
      return Report(table.name, id, status.message());
    take(std::move(value));
    return absl::OkStatus();
  });
}

absl::Status MapReader::ReadInfo() {
  CAIRN_ASSIGN_OR_RETURN(format_, database_->QueryInt("PRAGMA user_version"));
  int rows = 0;
  CAIRN_RETURN_IF_ERROR(ReadTable<MapRow>(kMapTable, [&](MapRow&& value) {
    map_row_ = std::move(value);
    ++rows;
  }));
  return rows == 1 ? absl::OkStatus() : Report("map", 0, absl::StrCat("there are ", rows, " good rows instead of one"));
}

absl::Status MapReader::ReadDescription() {
  CAIRN_RETURN_IF_ERROR(ReadTable<map::MapCamera>(
      kCamerasTable, [&](map::MapCamera&& value) { content_.cameras.push_back(std::move(value)); }));
  CAIRN_RETURN_IF_ERROR(ReadLenses());
  CAIRN_RETURN_IF_ERROR(ReadTable<map::Session>(
      kSessionsTable, [&](map::Session&& value) { content_.sessions.push_back(std::move(value)); }));
  CAIRN_RETURN_IF_ERROR(ReadTrajectories());
  if (format_ >= 4) {
    CAIRN_RETURN_IF_ERROR(ReadTable<map::Component>(
        kComponentsTable, [&](map::Component&& value) { content_.components.push_back(std::move(value)); }));
  }
  return absl::OkStatus();
}

absl::Status MapReader::ReadEntities() {
  CAIRN_RETURN_IF_ERROR(ReadDescription());
  CAIRN_RETURN_IF_ERROR(ReadTable<map::Keyframe>(kKeyframesTable, [&](map::Keyframe&& value) {
    keyframes_.push_back(std::make_shared<map::Keyframe>(std::move(value)));
  }));
  CAIRN_RETURN_IF_ERROR(ReadFeatures());
  CAIRN_RETURN_IF_ERROR(ReadPointIds());
  CAIRN_RETURN_IF_ERROR(ReadTable<PointRow>(kPointsTable, [&](PointRow&& value) { points_.push_back(value); }));
  CAIRN_RETURN_IF_ERROR(ReadTable<EdgeRow>(kCovisibilityTable, [&](EdgeRow&& value) { edges_.push_back(value); }));
  return CheckCounts();
}

absl::Status MapReader::ReadLenses() {
  if (format_ < 3) return absl::OkStatus();
  std::vector<LensRow> lenses;
  CAIRN_RETURN_IF_ERROR(ReadTable<LensRow>(kLensesTable, [&](const LensRow& row) { lenses.push_back(row); }));
  for (const LensRow& row : lenses) {
    const auto camera = std::find_if(content_.cameras.begin(), content_.cameras.end(),
                                     [&](const map::MapCamera& other) { return other.id == row.camera; });
    if (camera == content_.cameras.end()) {
      CAIRN_RETURN_IF_ERROR(Report(kLensesTable.name, row.camera.value(), "its camera is missing"));
    } else {
      camera->lens = row.lens;
    }
  }
  return absl::OkStatus();
}

absl::Status MapReader::ReadTrajectories() {
  if (format_ < 2) return absl::OkStatus();
  std::vector<LoopRow> loops;
  std::vector<TrajectoryRow> trajectories;
  CAIRN_RETURN_IF_ERROR(ReadTable<LoopRow>(kLoopsTable, [&](const LoopRow& row) { loops.push_back(row); }));
  CAIRN_RETURN_IF_ERROR(ReadTable<TrajectoryRow>(kTrajectoriesTable,
                                                 [&](TrajectoryRow&& row) { trajectories.push_back(std::move(row)); }));
  std::sort(loops.begin(), loops.end(), [](const LoopRow& a, const LoopRow& b) {
    return a.session != b.session ? a.session < b.session : a.number < b.number;
  });
  const auto find = [&](SessionId id) {
    return std::find_if(content_.sessions.begin(), content_.sessions.end(),
                        [id](const map::Session& session) { return session.id == id; });
  };
  for (LoopRow& row : loops) {
    const auto session = find(row.session);
    if (session == content_.sessions.end() || row.number != static_cast<int>(session->loops.size()) + 1) {
      CAIRN_RETURN_IF_ERROR(Report(kLoopsTable.name, row.session.value(), "its session or an earlier loop is missing"));
    } else {
      session->loops.push_back(row.loop);
    }
  }
  for (TrajectoryRow& row : trajectories) {
    const auto session = find(row.session);
    if (session == content_.sessions.end()) {
      CAIRN_RETURN_IF_ERROR(Report(kTrajectoriesTable.name, row.session.value(), "its session is missing"));
    } else {
      session->trajectory = std::move(row.trajectory);
    }
  }
  return absl::OkStatus();
}

map::Keyframe* MapReader::FindKeyframe(std::int64_t id) {
  const auto at = std::lower_bound(
      keyframes_.begin(), keyframes_.end(), id,
      [](const auto& keyframe, std::int64_t key) { return static_cast<std::int64_t>(keyframe->id.value()) < key; });
  if (at == keyframes_.end() || static_cast<std::int64_t>((*at)->id.value()) != id) return nullptr;
  return at->get();
}

absl::Status MapReader::ReadFeatures() {
  const absl::string_view table = kFeaturesTable.name;
  CAIRN_ASSIGN_OR_RETURN(const std::optional<std::uint32_t> num_words, ReadNumWords(database_));
  CAIRN_RETURN_IF_ERROR(ForEachRow(kFeaturesTable, [&](const Statement& row, std::int64_t id) -> absl::Status {
    map::Keyframe* keyframe = FindKeyframe(id);
    if (keyframe == nullptr) return Report(table, id, "there is no such keyframe");
    const auto camera = std::find_if(content_.cameras.begin(), content_.cameras.end(),
                                     [&](const map::MapCamera& other) { return other.id == keyframe->camera; });
    if (camera == content_.cameras.end()) return Report(kKeyframesTable.name, id, "its camera is missing");
    auto features = FeaturesFromRow(row, camera->pinhole, map_row_.info.orb.num_levels, num_words);
    if (!features.ok()) return Report(table, id, features.status().message());
    keyframe->features = std::make_shared<const map::KeyframeFeatures>(*std::move(features));
    return absl::OkStatus();
  }));
  for (const auto& keyframe : keyframes_) {
    if (!keyframe->features) CAIRN_RETURN_IF_ERROR(Report(table, keyframe->id.value(), "no good row for the keyframe"));
  }
  return absl::OkStatus();
}

absl::Status MapReader::ReadPointIds() {
  const absl::string_view table = kKeyframePointsTable.name;
  std::size_t good = 0;
  CAIRN_RETURN_IF_ERROR(ForEachRow(kKeyframePointsTable, [&](const Statement& row, std::int64_t id) -> absl::Status {
    map::Keyframe* keyframe = FindKeyframe(id);
    if (keyframe == nullptr) return Report(table, id, "there is no such keyframe");
    if (!keyframe->features) return absl::OkStatus();
    auto ids = PointIdsFromRow(row, keyframe->features->features.size());
    if (!ids.ok()) return Report(table, id, ids.status().message());
    keyframe->points = *std::move(ids);
    ++good;
    return absl::OkStatus();
  }));
  return good == keyframes_.size() ? absl::OkStatus() : Report(table, 0, "not every keyframe has a good row");
}

absl::Status MapReader::CheckCounts() {
  const std::pair<absl::string_view, std::pair<std::int64_t, std::size_t>> counts[] = {
      {"keyframes", {map_row_.keyframe_count, keyframes_.size()}},
      {"points", {map_row_.point_count, points_.size()}},
      {"covisibility", {map_row_.covisibility_count, edges_.size()}},
  };
  for (const auto& [table, count] : counts) {
    if (count.first == static_cast<std::int64_t>(count.second)) continue;
    CAIRN_RETURN_IF_ERROR(
        Report(table, 0, absl::StrCat("there are ", count.second, " good rows instead of ", count.first)));
  }
  return absl::OkStatus();
}

absl::Status MapReader::CheckVocabulary() {
  CAIRN_ASSIGN_OR_RETURN(Statement rows, database_->Prepare(kVocabularyTable.SelectSql("")));
  const absl::StatusOr<bool> found = rows.Step();
  if (!found.ok()) {
    if (!IsDamaged(found.status())) return found.status();
    return Report("vocabulary", 0, found.status().message());
  }
  if (*found && rows.Int(1) != BlobChecksum(rows.Blob(2))) {
    return Report("vocabulary", rows.Int(0), "bytes: wrong checksum");
  }
  if (!*found && map_row_.info.vocabulary_hash != 0) {
    return Report("vocabulary", 0, "the vocabulary that the map names is not there");
  }
  return absl::OkStatus();
}

absl::Status MapReader::CheckChanges() {
  Revision newest = 0;
  CAIRN_RETURN_IF_ERROR(ReadTable<LoggedChange>(kChangesTable, [&](LoggedChange&& value) { newest = value.revision; }));
  CAIRN_RETURN_IF_ERROR(CheckTouched());
  if (newest == map_row_.revision) return absl::OkStatus();
  return Report("changes", 0, absl::StrCat("ends at revision ", newest, ", the map is at ", map_row_.revision));
}

absl::Status MapReader::CheckTouched() {
  if (format_ < 4) return absl::OkStatus();
  CAIRN_ASSIGN_OR_RETURN(Statement rows, database_->Prepare(kTouchedTable.SelectSql("ORDER BY revision, kind")));
  while (true) {
    const absl::StatusOr<bool> found = rows.Step();
    if (!found.ok()) {
      if (!IsDamaged(found.status())) return found.status();
      return Report(kTouchedTable.name, 0, found.status().message());
    }
    if (!*found) return absl::OkStatus();
    if (rows.Int(2) != BlobChecksum(rows.Blob(3))) {
      CAIRN_RETURN_IF_ERROR(
          Report(kTouchedTable.name, rows.Int(0), absl::StrCat("ids of ", rows.Text(1), ": wrong checksum")));
    }
  }
}

absl::Status MapReader::LinkKeyframes() {
  for (const EdgeRow& edge : edges_) {
    map::Keyframe* a = FindKeyframe(edge.a.value());
    map::Keyframe* b = FindKeyframe(edge.b.value());
    if (a == nullptr || b == nullptr) {
      return Report("covisibility", edge.a.value(),
                    absl::StrCat("a keyframe of ", edge.a.value(), " - ", edge.b.value(), " is missing"));
    }
    a->covisible.push_back({edge.b, edge.shared_points});
    b->covisible.push_back({edge.a, edge.shared_points});
  }
  for (const auto& keyframe : keyframes_) {
    SortCovisible(keyframe.get());
    if (!keyframe->parent) continue;
    map::Keyframe* parent = FindKeyframe(keyframe->parent.value());
    if (parent == nullptr) return Report("keyframes", keyframe->id.value(), "the parent is missing");
    parent->children.push_back(keyframe->id);
  }
  return CheckTree();
}

absl::Status MapReader::CheckTree() {
  // Whatever cannot be reached from a root downwards is on, or below, a circle of parents.
  std::vector<const map::Keyframe*> reached;
  for (const auto& keyframe : keyframes_) {
    if (!keyframe->parent) reached.push_back(keyframe.get());
  }
  for (std::size_t i = 0; i < reached.size(); ++i) {
    for (const KeyframeId child : reached[i]->children) reached.push_back(FindKeyframe(child.value()));
  }
  if (reached.size() == keyframes_.size()) return absl::OkStatus();
  return Report("keyframes", 0, "the parents of some keyframes form a circle");
}

absl::Status MapReader::LinkPoints() {
  std::unordered_map<PointId, std::shared_ptr<map::MapPoint>> points;
  points.reserve(points_.size());
  std::vector<std::shared_ptr<map::MapPoint>> in_order;
  in_order.reserve(points_.size());
  for (const PointRow& row : points_) {
    auto point = std::make_shared<map::MapPoint>();
    point->id = row.id;
    point->position = row.position;
    point->times_visible = row.times_visible;
    point->times_found = row.times_found;
    points.emplace(row.id, point);
    in_order.push_back(std::move(point));
  }
  std::unordered_map<KeyframeId, Vector3d> center_of;
  for (const auto& keyframe : keyframes_) {
    center_of.emplace(keyframe->id, keyframe->CenterInMap());
    for (std::uint32_t i = 0; i < keyframe->points.size(); ++i) {
      if (!keyframe->points[i]) continue;
      const auto found = points.find(keyframe->points[i]);
      if (found == points.end()) {
        return Report("keyframe_points", keyframe->id.value(),
                      absl::StrCat("point ", keyframe->points[i].value(), " is missing"));
      }
      auto& observations = found->second->observations;
      if (!observations.empty() && observations.back().keyframe == keyframe->id) {
        return Report("keyframe_points", keyframe->id.value(),
                      absl::StrCat("point ", keyframe->points[i].value(), " is there twice"));
      }
      observations.push_back({keyframe->id, i});
    }
  }
  std::unordered_map<CameraId, double> focal_px;
  for (const map::MapCamera& camera : content_.cameras) focal_px.emplace(camera.id, camera.pinhole.fx_px);
  std::vector<Vector3d> centers;
  for (std::size_t i = 0; i < in_order.size(); ++i) {
    map::MapPoint& point = *in_order[i];
    centers.clear();
    bool has_reference = false;
    for (const map::Observation& observation : point.observations) {
      centers.push_back(center_of.at(observation.keyframe));
      if (observation.keyframe != points_[i].reference_keyframe) continue;
      point.reference = observation;
      has_reference = true;
    }
    if (!has_reference) return Report("points", point.id.value(), "the reference keyframe does not observe the point");
    const map::Keyframe& reference = *FindKeyframe(point.reference.keyframe.value());
    point.descriptor = reference.descriptors()[point.reference.feature];
    map::SetViewing(map::ComputeViewing(point.position, centers, center_of.at(reference.id),
                                        reference.keypoints()[point.reference.feature].octave,
                                        focal_px.at(reference.camera), map_row_.info.orb),
                    &point);
  }
  content_.points.assign(in_order.begin(), in_order.end());
  return absl::OkStatus();
}

void MapReader::SetWhatFormat4Added() {
  const auto next = [](const auto& entities, auto first) {
    for (const auto& entity : entities) first = std::max(first, decltype(first)(entity.id.value() + 1));
    return first;
  };
  content_.next_camera = next(content_.cameras, CameraId(1));
  content_.next_session = next(content_.sessions, SessionId(1));
  if (map_row_.revision == 0) return;
  content_.components = map::AssignComponents(map_row_.world_from_map, keyframes_, &content_.sessions);
  content_.next_component = next(content_.components, ComponentId(1));
}

absl::StatusOr<std::shared_ptr<const map::Snapshot>> MapReader::Assemble() {
  CAIRN_RETURN_IF_ERROR(LinkKeyframes());
  content_.next_camera = map_row_.next_camera;
  content_.next_session = map_row_.next_session;
  content_.next_component = map_row_.next_component;
  if (format_ < 4) SetWhatFormat4Added();
  CAIRN_RETURN_IF_ERROR(LinkPoints());
  content_.keyframes.assign(keyframes_.begin(), keyframes_.end());
  content_.next_keyframe = map_row_.next_keyframe;
  content_.next_point = map_row_.next_point;
  if (map_row_.revision == 0) {
    if (!content_.empty()) CAIRN_RETURN_IF_ERROR(Report("map", 1, "revision 0, but the map is not empty"));
    return map::Snapshot::Empty(map_row_.info);
  }
  content_.base = map_row_.revision - 1;
  auto snapshot = map::Snapshot::Empty(map_row_.info, content_.base)->Apply(content_);
  if (!snapshot.ok()) {
    CAIRN_RETURN_IF_ERROR(Report("", 0, snapshot.status().message()));
    return snapshot.status();
  }
  return snapshot;
}

}  // namespace cairn::store
