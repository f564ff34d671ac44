// SqliteMapStore: the map ready to be queried.
#include <algorithm>
#include <map>
#include <memory>
#include <utility>

#include "place/posting_segment.h"
#include "place/vocabulary.h"
#include "store/byte_stream.h"
#include "store/delta_reader.h"
#include "store/delta_writer.h"
#include "store/feature_reader.h"
#include "store/map_reader.h"
#include "store/ready_map.h"
#include "store/ready_writer.h"
#include "store/row.h"
#include "store/sqlite.h"
#include "store/sqlite_map_store.h"

namespace cairn::store {
namespace {

// Of a place index, so many keyframes that have left the map, and this part of those in it, are carried along.
constexpr std::size_t kMaxGone = 200, kMaxGoneShare = 2;
// Features that are looked at while pages are written, most of them once.
constexpr std::size_t kFeatureBudgetBytes = 16'000'000;

// A map whose index names what is not there is not ready.
bool Refers(const ReadyIndex& index, const map::Delta& description) {
  std::map<CameraId, bool> cameras;
  for (const auto& [camera, focal] : index.focal_px) cameras[camera] = true;
  const auto known = [](const auto& entities, auto id) {
    return std::ranges::any_of(entities, [id](const auto& entity) { return entity.id == id; });
  };
  SessionId session;
  ComponentId component;
  CameraId camera;
  for (const ReadyKeyframe& keyframe : index.keyframes()) {
    if (keyframe.session != session && !known(description.sessions, keyframe.session)) return false;
    if (keyframe.component != component && !known(description.components, keyframe.component)) return false;
    if (keyframe.camera != camera && (!known(description.cameras, keyframe.camera) || !cameras[keyframe.camera])) {
      return false;
    }
    session = keyframe.session, component = keyframe.component, camera = keyframe.camera;
  }
  return true;
}

// The segments of the place index, each as it comes.
absl::Status ReadSegments(Database* database, const ReadyIndex& index, const ReadyOptions& options) {
  std::vector<KeyframeId> keyframes;
  CAIRN_ASSIGN_OR_RETURN(
      Statement rows,
      database->Prepare("SELECT revision, bytes_checksum, length(bytes) FROM ready_pages WHERE id = ?"));
  for (std::uint32_t number = 0; number < index.segments.size(); ++number) {
    const std::int64_t page = ReadyRowId(ReadyKind::kPlaces, number);
    rows.Bind(1, page);
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
    if (!found) return absl::DataLossError("a part of the place index is missing");
    const auto revision = static_cast<Revision>(rows.Int(0));
    const std::int64_t checksum = rows.Int(1);
    const auto size = static_cast<std::size_t>(rows.Int(2));
    rows.Reset();
    // They are most of what opening reads: not copied on the way.
    std::span<char> memory;
    const SharedBytes bytes = SharedBytes::New(size, &memory);
    CAIRN_ASSIGN_OR_RETURN(const bool read, database->ReadBlob("ready_pages", "bytes", page, memory));
    if (!read) return absl::DataLossError("a part of the place index is no blob");
    const Bytes sealed(reinterpret_cast<const std::uint8_t*>(memory.data()), memory.size());
    CAIRN_ASSIGN_OR_RETURN(const Bytes content, OpenReadyPage(page, revision, checksum, sealed));
    keyframes = index.segments[number];
    for (KeyframeId& id : keyframes) {
      if (index.Find(id) == nullptr) id = KeyframeId();
    }
    CAIRN_RETURN_IF_ERROR(options.segment(keyframes, bytes.From(size - content.size())));
  }
  return absl::OkStatus();
}

map::SnapshotParts PartsOf(const ReadyIndex& index, const MapRow& map_row, map::Delta description) {
  map::SnapshotParts parts;
  parts.revision = index.revision;
  parts.info = map_row.info;
  parts.cameras = std::move(description.cameras);
  parts.sessions = std::move(description.sessions);
  parts.components = std::move(description.components);
  for (const ReadyKeyframe& keyframe : index.keyframes()) ++parts.num_keyframes[keyframe.component];
  parts.next_keyframe = index.next_keyframe;
  parts.next_point = index.next_point;
  parts.next_camera = map_row.next_camera;
  parts.next_session = map_row.next_session;
  parts.next_component = map_row.next_component;
  return parts;
}

}  // namespace

absl::StatusOr<std::optional<ReadyMap>> SqliteMapStore::LoadReady(const ReadyOptions& options) {
  const auto load = [&]() -> absl::StatusOr<std::optional<ReadyMap>> {
    CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<map::FeatureReader> features,
                           OpenFeatureReader(path_, resolved_, identity_));
    auto cache = map::FeatureCache::Create(std::move(features), options.feature_budget_bytes);
    CAIRN_ASSIGN_OR_RETURN(const Transaction transaction,
                           Transaction::Begin(database_.get(), Transaction::Kind::kRead));
    CAIRN_ASSIGN_OR_RETURN(std::optional<ReadyIndex> index, ReadReadyIndex(database_.get()));
    if (!index) return std::nullopt;
    MapReader reader(database_.get(), DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    CAIRN_RETURN_IF_ERROR(reader.ReadDescription());
    const MapRow& map_row = reader.map_row();
    if (index->revision > map_row.revision || index->revision < map_row.oldest_delta_base ||
        !Refers(*index, reader.content())) {
      return std::nullopt;
    }
    if (options.segment) CAIRN_RETURN_IF_ERROR(ReadSegments(database_.get(), *index, options));
    map::SnapshotParts parts = PartsOf(*index, map_row, reader.content());
    CAIRN_ASSIGN_OR_RETURN(parts.entities,
                           OpenReadySource(path_, resolved_, identity_, *std::move(index), map_row.info.orb, cache));
    parts.feature_cache = cache;
    ReadyMap ready;
    ready.map = map::Snapshot::Of(std::move(parts));
    if (ready.map->revision() != map_row.revision) {
      CAIRN_ASSIGN_OR_RETURN(ready.since, DeltaReader(database_.get(), *ready.map).Read());
      if (!ready.since) return std::nullopt;
      // Cameras, sessions and components are the newest already.
      ready.since->removed_cameras.clear();
      ready.since->removed_components.clear();
    }
    CAIRN_RETURN_IF_ERROR(CheckUnchanged());
    CAIRN_RETURN_IF_ERROR(cache->status());
    return ready;
  };
  auto loaded = load();
  // Whatever is wrong is told by who loads the map without this.
  if (!loaded.ok()) return std::nullopt;
  return loaded;
}

namespace {

// Brings the ready pages of an open map to its newest revision.
class ReadyRefresh {
 public:
  ReadyRefresh(SqliteMapStore* store, Database* database, DeltaWriter* writer)
      : store_(store), database_(database), writer_(writer) {}

  absl::Status Run() {
    CAIRN_ASSIGN_OR_RETURN(const MapRow map_row, writer_->ReadMapRow());
    absl::StatusOr<std::optional<ReadyIndex>> before = ReadReadyIndex(database_);
    if (before.ok() && *before && (*before)->revision == map_row.revision) return absl::OkStatus();
    if (map_row.revision == 0 || map_row.info.vocabulary_hash == 0) return absl::OkStatus();
    CAIRN_ASSIGN_OR_RETURN(const std::string bytes, store_->LoadVocabulary());
    CAIRN_ASSIGN_OR_RETURN(const place::Vocabulary vocabulary, place::Vocabulary::Parse(bytes));
    if (vocabulary.hash() != map_row.info.vocabulary_hash) return absl::OkStatus();
    for (place::WordId word = 0; word < vocabulary.num_words(); ++word) idf_.push_back(vocabulary.weight(word));
    revision_ = map_row.revision;
    if (before.ok() && *before) {
      CAIRN_ASSIGN_OR_RETURN(const bool done, WriteChanges(**before));
      if (done) return absl::OkStatus();
    }
    return WriteAll();
  }

 private:
  absl::StatusOr<ReadyPageWriter> Begin() {
    return ReadyPageWriter::Begin(database_, revision_, [this]() -> absl::Status {
      // By its row of the map a change is known as this file's (write_ahead_log.h). SQLite leaves out pages whose bytes
      // are written as they were: the row is changed, and changed back.
      CAIRN_ASSIGN_OR_RETURN(const MapRow row, writer_->ReadMapRow());
      MapRow other = row;
      ++other.log_schema_cookie;
      CAIRN_RETURN_IF_ERROR(writer_->PutMapRow(other));
      return writer_->PutMapRow(row);
    });
  }

  // Words that wait for a segment of their own.
  struct Waiting {
    std::vector<KeyframeId> keyframes;
    std::vector<std::vector<place::WordId>> words;
  };

  // The keyframes go into the index of segments, and what is waiting is empty again.
  std::string Pack(Waiting* waiting, std::vector<KeyframeId>* segment) const {
    std::vector<std::span<const place::WordId>> words;
    for (const std::vector<place::WordId>& of_keyframe : waiting->words) words.emplace_back(of_keyframe);
    std::string packed = place::PostingSegment(0, words, idf_).Pack();
    *segment = std::move(waiting->keyframes);
    *waiting = {};
    return packed;
  }

  // False if the words are not those of the vocabulary.
  bool Add(KeyframeId keyframe, const std::vector<place::WordId>& words, std::size_t num_features, Waiting* waiting) {
    if (words.size() != num_features) return false;
    if (std::ranges::any_of(words, [&](place::WordId word) { return word >= idf_.size(); })) return false;
    waiting->keyframes.push_back(keyframe);
    waiting->words.push_back(words);
    return true;
  }

  absl::Status WriteAll() {
    CAIRN_ASSIGN_OR_RETURN(ReadyPageWriter out, Begin());
    Waiting waiting;
    bool good = true;
    std::vector<std::vector<KeyframeId>> segments;
    std::vector<std::string> packed;
    LoadOptions load;
    load.feature_budget_bytes = kFeatureBudgetBytes;
    load.words = [&](KeyframeId keyframe, const std::vector<std::uint32_t>& words) {
      good = good && !words.empty() && Add(keyframe, words, words.size(), &waiting);
      if (good && waiting.keyframes.size() == place::PostingSegment::kMaxEntries) {
        packed.push_back(Pack(&waiting, &segments.emplace_back()));
      }
      return absl::OkStatus();
    };
    CAIRN_ASSIGN_OR_RETURN(const auto map, store_->LoadSnapshot(load));
    if (!good) return absl::OkStatus();
    if (!waiting.keyframes.empty()) packed.push_back(Pack(&waiting, &segments.emplace_back()));
    CAIRN_ASSIGN_OR_RETURN(std::optional<ReadyIndex> index, IndexOf(*map));
    if (!index) return absl::OkStatus();
    index->segments = std::move(segments);
    for (std::uint32_t number = 0; number < packed.size(); ++number) {
      CAIRN_RETURN_IF_ERROR(out.Put(ReadyKind::kPlaces, number, packed[number]));
    }
    packed.clear();
    for (std::uint32_t page = 0; page * kKeyframesPerPage < map->next_keyframe().value(); ++page) {
      const auto keyframes = KeyframesOfPage(*map, page);
      if (keyframes.empty()) continue;
      CAIRN_RETURN_IF_ERROR(out.Put(ReadyKind::kKeyframes, page, PackReadyKeyframes(keyframes)));
    }
    for (std::uint32_t page = 0; page * std::uint64_t{kPointsPerPage} < map->next_point().value(); ++page) {
      const auto points = PointsOfPage(*map, page);
      if (points.empty()) continue;
      CAIRN_RETURN_IF_ERROR(out.Put(ReadyKind::kPoints, page, PackReadyPoints(points)));
    }
    return out.Finish(*index, /*all=*/true);
  }

  // False if it must be written as a whole.
  absl::StatusOr<bool> WriteChanges(const ReadyIndex& before) {
    ReadyOptions options;
    options.feature_budget_bytes = kFeatureBudgetBytes;
    CAIRN_ASSIGN_OR_RETURN(const std::optional<ReadyMap> ready, store_->LoadReady(options));
    if (!ready || !ready->since || ready->map->revision() != before.revision) return false;
    const map::Delta& since = *ready->since;
    CAIRN_ASSIGN_OR_RETURN(const auto map, ready->map->Apply(since));
    CAIRN_ASSIGN_OR_RETURN(std::optional<ReadyIndex> index, UpdatedIndex(before, since, *map));
    if (!index) return false;
    CAIRN_ASSIGN_OR_RETURN(ReadyPageWriter out, Begin());
    CAIRN_ASSIGN_OR_RETURN(const bool words, WriteNewSegments(before, *map, &*index, &out));
    if (!words) return false;
    std::vector<KeyframeId> keyframes = since.removed_keyframes;
    for (const auto& keyframe : since.keyframes) keyframes.push_back(keyframe->id);
    for (const std::uint32_t page : PagesOf(keyframes, kKeyframesPerPage)) {
      const auto of_page = KeyframesOfPage(*map, page);
      CAIRN_RETURN_IF_ERROR(of_page.empty() ? out.Remove(ReadyKind::kKeyframes, page)
                                            : out.Put(ReadyKind::kKeyframes, page, PackReadyKeyframes(of_page)));
    }
    std::vector<PointId> points = since.removed_points;
    for (const auto& point : since.points) points.push_back(point->id);
    for (const std::uint32_t page : PagesOf(points, kPointsPerPage)) {
      const auto of_page = PointsOfPage(*map, page);
      CAIRN_RETURN_IF_ERROR(of_page.empty() ? out.Remove(ReadyKind::kPoints, page)
                                            : out.Put(ReadyKind::kPoints, page, PackReadyPoints(of_page)));
    }
    // What was read on the way must have been good.
    CAIRN_RETURN_IF_ERROR(ready->map->feature_cache()->status());
    CAIRN_RETURN_IF_ERROR(out.Finish(*index, /*all=*/false));
    return true;
  }

  // The index after a change, made from the one before: keyframes and points that are as they were are not looked at.
  absl::StatusOr<std::optional<ReadyIndex>> UpdatedIndex(const ReadyIndex& before, const map::Delta& since,
                                                         const map::Snapshot& map) {
    ReadyIndex index;
    index.revision = map.revision();
    index.next_keyframe = map.next_keyframe();
    index.next_point = map.next_point();
    for (const auto& [id, camera] : map.cameras()) index.focal_px.emplace_back(id, camera.pinhole.fx_px);
    // Points take their size from a camera: it must be the one that it was.
    for (const auto& focal : before.focal_px) {
      const auto same = std::ranges::find(index.focal_px, focal.first, &std::pair<CameraId, double>::first);
      if (same != index.focal_px.end() && same->second != focal.second) return std::nullopt;
    }
    std::map<KeyframeId, const map::Keyframe*> changed;
    for (const KeyframeId id : since.removed_keyframes) changed[id] = nullptr;
    for (const auto& keyframe : since.keyframes) changed[keyframe->id] = keyframe.get();
    auto next = changed.begin();
    const auto add_changed = [&](KeyframeId end) {
      for (; next != changed.end() && next->first < end; ++next) {
        const map::Keyframe* keyframe = next->second;
        if (keyframe == nullptr) continue;
        index.AddKeyframe({keyframe->id, keyframe->session, keyframe->camera, keyframe->component,
                           keyframe->camera_from_map, static_cast<std::uint32_t>(keyframe->features.size())});
      }
    };
    for (const ReadyKeyframe& keyframe : before.keyframes()) {
      add_changed(keyframe.id);
      if (!changed.contains(keyframe.id)) index.AddKeyframe(keyframe);
    }
    add_changed(index.next_keyframe);
    std::vector<PointId> gone = since.removed_points;
    for (std::uint32_t id = 1; id < before.next_point.value(); ++id) {
      if (before.HasPoint(PointId(id)) && !std::ranges::binary_search(gone, PointId(id))) index.AddPoint(PointId(id));
    }
    for (const auto& point : since.points) {
      if (!index.HasPoint(point->id)) index.AddPoint(point->id);
    }
    return index;
  }

  // Keyframes that are in no segment go into the last one, with those that are, or into new ones.
  absl::StatusOr<bool> WriteNewSegments(const ReadyIndex& before, const map::Snapshot& map, ReadyIndex* index,
                                        ReadyPageWriter* out) {
    index->segments = before.segments;
    std::size_t entries = 0;
    std::vector<bool> known(index->next_keyframe.value(), false);
    for (const auto& segment : index->segments) {
      entries += segment.size();
      for (const KeyframeId id : segment) {
        if (id < index->next_keyframe) known[id.value()] = true;
      }
    }
    if (entries > kMaxGoneShare * index->keyframes().size() + kMaxGone) return false;
    std::vector<KeyframeId> fresh;
    for (const ReadyKeyframe& keyframe : index->keyframes()) {
      if (!known[keyframe.id.value()]) fresh.push_back(keyframe.id);
    }
    if (fresh.empty()) return true;
    auto number = static_cast<std::uint32_t>(index->segments.size());
    if (number > 0 && index->segments.back().size() + fresh.size() <= place::PostingSegment::kMaxEntries) {
      --number;
      std::vector<KeyframeId> together = index->segments.back();
      std::erase_if(together, [&](KeyframeId id) { return index->Find(id) == nullptr; });
      together.insert(together.end(), fresh.begin(), fresh.end());
      fresh = std::move(together);
    }
    Waiting waiting;
    const auto put = [&]() -> absl::Status {
      index->segments.resize(std::max<std::size_t>(index->segments.size(), number + std::size_t{1}));
      const std::string packed = Pack(&waiting, &index->segments[number]);
      return out->Put(ReadyKind::kPlaces, number++, packed);
    };
    for (const KeyframeId id : fresh) {
      const auto features = map.keyframe(id).features.Get();
      if (!Add(id, features->words, features->features.size(), &waiting)) return false;
      if (waiting.keyframes.size() == place::PostingSegment::kMaxEntries) CAIRN_RETURN_IF_ERROR(put());
    }
    if (!waiting.keyframes.empty()) CAIRN_RETURN_IF_ERROR(put());
    return true;
  }

  SqliteMapStore* store_;
  Database* database_;
  DeltaWriter* writer_;
  Revision revision_ = 0;
  std::vector<float> idf_;
};

}  // namespace

absl::Status SqliteMapStore::RefreshReady() { return ReadyRefresh(this, database_.get(), writer_.get()).Run(); }

}  // namespace cairn::store
