#include "store/map_reader.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "store/blobs.h"
#include "store/each_row.h"
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

absl::StatusOr<FeatureBlobs> FeatureBlobsFromRow(const Statement& row, const Pinhole* camera, int num_levels) {
  const Bytes keypoints = row.Blob(7), descriptors = row.Blob(8), words = row.Blob(9);
  if (row.Int(4) != BlobChecksum(keypoints)) return absl::DataLossError("keypoints: wrong checksum");
  if (row.Int(5) != BlobChecksum(descriptors)) return absl::DataLossError("descriptors: wrong checksum");
  if (row.Int(6) != BlobChecksum(words)) return absl::DataLossError("words: wrong checksum");
  CAIRN_ASSIGN_OR_RETURN(const auto blobs,
                         FeatureBlobs::Create(row.Int(1), row.Int(2), row.Int(3), keypoints, descriptors, words));
  const absl::string_view wrong = WrongKeypoints(blobs, camera, num_levels);
  if (!wrong.empty()) return absl::DataLossError(wrong);
  return blobs;
}

absl::StatusOr<map::KeyframeFeatures> FeaturesFromRow(const Statement& row, const Pinhole* camera, int num_levels,
                                                      std::optional<std::uint32_t> num_words) {
  CAIRN_ASSIGN_OR_RETURN(const auto blobs, FeatureBlobsFromRow(row, camera, num_levels));
  map::KeyframeFeatures features = blobs.Unpack();
  const absl::string_view wrong = num_words ? WrongWords(features.words, *num_words) : "";
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
  std::uint32_t num_words = 0;
  std::array<char, kNumWordsAt + sizeof(num_words)> start;
  const auto read = database->ReadBlob("vocabulary", "bytes", 1, start);
  if (!read.ok() && !IsDamaged(read.status())) return read.status();
  if (!read.ok() || !*read || std::memcmp(start.data(), kMagic.data(), kMagic.size()) != 0) {
    return std::optional<std::uint32_t>();
  }
  std::memcpy(&num_words, start.data() + kNumWordsAt, sizeof(num_words));
  return num_words;
}

absl::Status MapReader::Report(absl::string_view table, std::int64_t id, absl::string_view message) {
  return sink_(Finding{std::string(table), id, std::string(message)});
}

template <class Use>
absl::Status MapReader::ForEachRow(const TableSpec& table, Use use) {
  return store::ForEachRow(
      database_, table, rows_.format,
      [this](absl::string_view name, std::int64_t id, absl::string_view message) { return Report(name, id, message); },
      std::move(use));
}

template <class Value, class Take>
absl::Status MapReader::ReadTable(const TableSpec& table, Take take) {
  return ForEachChecked<Value>(
      database_, table, rows_.format,
      [this](absl::string_view name, std::int64_t id, absl::string_view message) { return Report(name, id, message); },
      [&](Value&& value) {
        take(std::move(value));
        return absl::OkStatus();
      });
}

absl::Status MapReader::ReadInfo() {
  CAIRN_ASSIGN_OR_RETURN(rows_.format, database_->QueryInt("PRAGMA user_version"));
  int rows = 0;
  CAIRN_RETURN_IF_ERROR(ReadTable<MapRow>(kMapTable, [&](MapRow&& value) {
    rows_.map_row = std::move(value);
    ++rows;
  }));
  return rows == 1 ? absl::OkStatus() : Report("map", 0, absl::StrCat("there are ", rows, " good rows instead of one"));
}

absl::Status MapReader::ReadDescription() {
  CAIRN_RETURN_IF_ERROR(ReadTable<map::MapCamera>(
      kCamerasTable, [&](map::MapCamera&& value) { rows_.content.cameras.push_back(std::move(value)); }));
  CAIRN_RETURN_IF_ERROR(ReadLenses());
  CAIRN_RETURN_IF_ERROR(ReadTable<map::Session>(
      kSessionsTable, [&](map::Session&& value) { rows_.content.sessions.push_back(std::move(value)); }));
  CAIRN_RETURN_IF_ERROR(ReadTrajectories());
  if (rows_.format >= 4) {
    CAIRN_RETURN_IF_ERROR(ReadTable<map::Component>(
        kComponentsTable, [&](map::Component&& value) { rows_.content.components.push_back(std::move(value)); }));
  }
  return CheckRowCounts(Counted::kDescription);
}

absl::Status MapReader::CheckRowCounts(Counted which) {
  if (rows_.format != kNewestFormat) return absl::OkStatus();
  return store::CheckRowCounts(database_, rows_.map_row.revision, which, sink_);
}

absl::Status MapReader::ReadEntities(const FeatureUse& use) {
  CAIRN_RETURN_IF_ERROR(ReadDescription());
  CAIRN_RETURN_IF_ERROR(ReadTable<map::Keyframe>(kKeyframesTable, [&](map::Keyframe&& value) {
    rows_.keyframes.push_back(std::make_shared<map::Keyframe>(std::move(value)));
  }));
  const auto read_points = [&] {
    // A count that is damaged is told later.
    rows_.points.reserve(static_cast<std::size_t>(std::clamp<std::int64_t>(rows_.map_row.point_count, 0, 1 << 24)));
    PointBlocks blocks;
    return ReadTable<PointRow>(kPointsTable, [&](const PointRow& value) {
      rows_.points.push_back(blocks.Next());
      SetFromRow(value, rows_.points.back().get());
    });
  };
  // What points take from features that are not kept must be known while these go by.
  if (use.on_demand == nullptr) CAIRN_RETURN_IF_ERROR(ReadFeatures(use));
  CAIRN_RETURN_IF_ERROR(ReadPointIds(use.on_demand != nullptr));
  CAIRN_RETURN_IF_ERROR(read_points());
  if (use.on_demand != nullptr) CAIRN_RETURN_IF_ERROR(ReadFeatures(use));
  CAIRN_RETURN_IF_ERROR(ReadTable<EdgeRow>(kCovisibilityTable, [&](EdgeRow&& value) { rows_.edges.push_back(value); }));
  return CheckCounts();
}

absl::Status MapReader::ReadLenses() {
  if (rows_.format < 3) return absl::OkStatus();
  std::vector<LensRow> lenses;
  CAIRN_RETURN_IF_ERROR(ReadTable<LensRow>(kLensesTable, [&](const LensRow& row) { lenses.push_back(row); }));
  for (const LensRow& row : lenses) {
    const auto camera = std::find_if(rows_.content.cameras.begin(), rows_.content.cameras.end(),
                                     [&](const map::MapCamera& other) { return other.id == row.camera; });
    if (camera == rows_.content.cameras.end()) {
      CAIRN_RETURN_IF_ERROR(Report(kLensesTable.name, row.camera.value(), "its camera is missing"));
    } else {
      camera->lens = row.lens;
    }
  }
  return absl::OkStatus();
}

absl::Status MapReader::ReadTrajectories() {
  if (rows_.format < 2) return absl::OkStatus();
  std::vector<LoopRow> loops;
  std::vector<TrajectoryRow> trajectories;
  CAIRN_RETURN_IF_ERROR(ReadTable<LoopRow>(kLoopsTable, [&](const LoopRow& row) { loops.push_back(row); }));
  CAIRN_RETURN_IF_ERROR(ReadTable<TrajectoryRow>(kTrajectoriesTable,
                                                 [&](TrajectoryRow&& row) { trajectories.push_back(std::move(row)); }));
  std::sort(loops.begin(), loops.end(), [](const LoopRow& a, const LoopRow& b) {
    return a.session != b.session ? a.session < b.session : a.number < b.number;
  });
  const auto find = [&](SessionId id) {
    return std::find_if(rows_.content.sessions.begin(), rows_.content.sessions.end(),
                        [id](const map::Session& session) { return session.id == id; });
  };
  for (LoopRow& row : loops) {
    const auto session = find(row.session);
    if (session == rows_.content.sessions.end() || row.number != static_cast<int>(session->loops.size()) + 1) {
      CAIRN_RETURN_IF_ERROR(Report(kLoopsTable.name, row.session.value(), "its session or an earlier loop is missing"));
    } else {
      session->loops.push_back(row.loop);
    }
  }
  for (TrajectoryRow& row : trajectories) {
    const auto session = find(row.session);
    if (session == rows_.content.sessions.end()) {
      CAIRN_RETURN_IF_ERROR(Report(kTrajectoriesTable.name, row.session.value(), "its session is missing"));
    } else {
      session->trajectory = std::move(row.trajectory);
    }
  }
  return absl::OkStatus();
}

void MapReader::SetAnchors(const map::Keyframe& keyframe, const FeatureBlobs& features, const IdIndex& index,
                           const std::vector<KeyframeId>& reference_of) {
  for (std::uint32_t i = 0; i < keyframe.points.size(); ++i) {
    const std::size_t row = keyframe.points[i] ? index.Find(keyframe.points[i].value()) : IdIndex::kNone;
    if (row == IdIndex::kNone || reference_of[row] != keyframe.id) continue;
    rows_.points[row]->descriptor = features.descriptor(i);
    rows_.octaves[row] = features.octave(i);
  }
}

absl::Status MapReader::ReadFeatures(const FeatureUse& use) {
  const absl::string_view table = kFeaturesTable.name;
  std::optional<IdIndex> index;
  std::vector<KeyframeId> reference_of;  // of points, here to be asked for again and again
  if (use.on_demand != nullptr) {
    index.emplace(rows_.points);
    rows_.octaves.resize(rows_.points.size());
    reference_of.reserve(rows_.points.size());
    for (const auto& point : rows_.points) reference_of.push_back(point->reference.keyframe);
  }
  CAIRN_ASSIGN_OR_RETURN(const std::optional<std::uint32_t> num_words, ReadNumWords(database_));
  CAIRN_RETURN_IF_ERROR(ForEachRow(kFeaturesTable, [&](const Statement& row, std::int64_t id) -> absl::Status {
    map::Keyframe* keyframe = rows_.FindKeyframe(id);
    if (keyframe == nullptr) return Report(table, id, "there is no such keyframe");
    const auto camera = std::find_if(rows_.content.cameras.begin(), rows_.content.cameras.end(),
                                     [&](const map::MapCamera& other) { return other.id == keyframe->camera; });
    const bool known = camera != rows_.content.cameras.end();
    if (const absl::Status status =
            known ? absl::OkStatus() : Report(kKeyframesTable.name, id, "its camera is missing");
        !status.ok()) {
      return status;
    }
    const auto blobs = FeatureBlobsFromRow(row, known ? &camera->pinhole : nullptr, rows_.map_row.info.orb.num_levels);
    if (!blobs.ok()) return Report(table, id, blobs.status().message());
    const std::vector<std::uint32_t> words = blobs->Words();
    const absl::string_view wrong = num_words ? WrongWords(words, *num_words) : "";
    if (!wrong.empty()) return Report(table, id, wrong);
    if (use.words) {
      if (absl::Status status = use.words(keyframe->id, words); !status.ok()) return status;
    }
    if (use.on_demand == nullptr) {
      keyframe->features = std::make_shared<const map::KeyframeFeatures>(blobs->Unpack());
      return absl::OkStatus();
    }
    if (blobs->size() != keyframe->points.size()) {
      return Report(kKeyframePointsTable.name, id, "not one point per feature");
    }
    SetAnchors(*keyframe, *blobs, *index, reference_of);
    keyframe->features = use.on_demand->OnDemand(keyframe->id, blobs->size());
    return absl::OkStatus();
  }));
  for (const auto& keyframe : rows_.keyframes) {
    if (!keyframe->features) CAIRN_RETURN_IF_ERROR(Report(table, keyframe->id.value(), "no good row for the keyframe"));
  }
  return absl::OkStatus();
}

absl::Status MapReader::ReadPointIds(bool features_come_later) {
  const absl::string_view table = kKeyframePointsTable.name;
  std::size_t good = 0;
  CAIRN_RETURN_IF_ERROR(ForEachRow(kKeyframePointsTable, [&](const Statement& row, std::int64_t id) -> absl::Status {
    map::Keyframe* keyframe = rows_.FindKeyframe(id);
    if (keyframe == nullptr) return Report(table, id, "there is no such keyframe");
    if (!features_come_later && !keyframe->features) return absl::OkStatus();
    auto ids = PointIdsFromRow(row, keyframe->features ? keyframe->features.size() : NumPackedPointIds(row.Blob(2)));
    if (!ids.ok()) return Report(table, id, ids.status().message());
    keyframe->points = *std::move(ids);
    ++good;
    return absl::OkStatus();
  }));
  return good == rows_.keyframes.size() ? absl::OkStatus() : Report(table, 0, "not every keyframe has a good row");
}

absl::Status MapReader::CheckCounts() {
  const std::pair<absl::string_view, std::pair<std::int64_t, std::size_t>> counts[] = {
      {"keyframes", {rows_.map_row.keyframe_count, rows_.keyframes.size()}},
      {"points", {rows_.map_row.point_count, rows_.points.size()}},
      {"covisibility", {rows_.map_row.covisibility_count, rows_.edges.size()}},
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
  if (!*found && rows_.map_row.info.vocabulary_hash != 0) {
    return Report("vocabulary", 0, "the vocabulary that the map names is not there");
  }
  return absl::OkStatus();
}

absl::Status MapReader::CheckChanges() {
  Revision newest = 0;
  CAIRN_RETURN_IF_ERROR(ReadTable<LoggedChange>(kChangesTable, [&](LoggedChange&& value) { newest = value.revision; }));
  CAIRN_RETURN_IF_ERROR(CheckTouched());
  CAIRN_RETURN_IF_ERROR(CheckRowCounts(Counted::kLog));
  if (newest == rows_.map_row.revision) return absl::OkStatus();
  return Report("changes", 0, absl::StrCat("ends at revision ", newest, ", the map is at ", rows_.map_row.revision));
}

absl::Status MapReader::CheckTouched() {
  if (rows_.format < 4) return absl::OkStatus();
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

absl::StatusOr<std::shared_ptr<const map::Snapshot>> MapReader::Assemble() {
  const MapRow map_row = rows_.map_row;
  CAIRN_ASSIGN_OR_RETURN(const map::Delta content, AssembleMap(std::move(rows_), sink_));
  rows_.map_row = map_row;
  if (map_row.revision == 0) {
    if (!content.empty()) CAIRN_RETURN_IF_ERROR(Report("map", 1, "revision 0, but the map is not empty"));
    return map::Snapshot::Empty(map_row.info);
  }
  auto snapshot = map::Snapshot::Empty(map_row.info, content.base)->Apply(content);
  if (!snapshot.ok()) {
    CAIRN_RETURN_IF_ERROR(Report("", 0, snapshot.status().message()));
    return snapshot.status();
  }
  return snapshot;
}

}  // namespace cairn::store
