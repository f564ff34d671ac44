#include "store/digest.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <optional>
#include <type_traits>
#include <utility>
#include <vector>

#include "absl/strings/str_format.h"
#include "geometry/camera.h"
#include "store/map_assembly.h"
#include "store/map_reader.h"
#include "store/sqlite.h"
#include "store/tables.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace cairn::store {

class DigestHasher {
 public:
  DigestHasher() { XXH3_128bits_reset(&state_); }

  template <class Number>
  requires std::is_arithmetic_v<Number>
  void Add(Number value) {
    if (filled_ + sizeof(value) > buffer_.size()) Flush();
    std::memcpy(buffer_.data() + filled_, &value, sizeof(value));
    filled_ += sizeof(value);
  }
  // Of numbers that lie together, one after another.
  template <class T>
  requires std::is_trivially_copyable_v<T>
  void AddAll(const std::vector<T>& values) {
    Flush();
    XXH3_128bits_update(&state_, values.data(), values.size() * sizeof(T));
  }
  template <class Tag>
  void Add(Id<Tag> id) {
    Add(id.value());
  }
  void Add(absl::string_view text) {
    Add(static_cast<std::uint64_t>(text.size()));
    Flush();
    XXH3_128bits_update(&state_, text.data(), text.size());
  }
  void Add(const Quaterniond& q) {
    for (const double value : {q.x(), q.y(), q.z(), q.w()}) Add(value);
  }
  void Add(const Vector3d& v) {
    for (const double value : {v.x(), v.y(), v.z()}) Add(value);
  }
  void Add(const SE3& pose) {
    Add(pose.rotation());
    Add(pose.translation());
  }
  void Add(const Pinhole& camera) {
    Add(camera.width_px);
    Add(camera.height_px);
    for (const double value : {camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px}) Add(value);
  }
  void AddCount(std::size_t count) { Add(static_cast<std::uint64_t>(count)); }

  std::string Digest() {
    Flush();
    const XXH128_hash_t hash = XXH3_128bits_digest(&state_);
    return absl::StrFormat("%016x%016x", hash.high64, hash.low64);
  }

 private:
  void Flush() {
    XXH3_128bits_update(&state_, buffer_.data(), filled_);
    filled_ = 0;
  }

  // XXH3 keeps its state in aligned memory.
  alignas(64) XXH3_state_t state_;
  // The hash is of one row of bytes, however it is cut; taking them number by number would be most of the work.
  std::array<char, 4096> buffer_;
  std::size_t filled_ = 0;
};

namespace {

void Add(const std::optional<Sim3>& similarity, DigestHasher* hasher) {
  hasher->Add(similarity.has_value());
  if (!similarity) return;
  hasher->Add(similarity->scale());
  hasher->Add(similarity->rotation());
  hasher->Add(similarity->translation());
}

// A map of one component has the digest that it had in formats without components.
bool HasParts(const map::Snapshot& map) { return map.components().size() > 1; }

void AddInfo(const map::Snapshot& map, DigestHasher* hasher) {
  const map::MapInfo& info = map.info();
  const image::OrbParameters& orb = info.orb;
  for (const int value : {orb.num_features, orb.num_levels, orb.fast_threshold, orb.min_fast_threshold})
    hasher->Add(value);
  hasher->Add(orb.scale_factor);
  hasher->Add(info.vocabulary_hash);
  if (!HasParts(map)) {
    Add(map.components().empty() ? std::nullopt : map.components().begin()->second.world_from_component, hasher);
  }
  if (const auto& anchor = info.geo_anchor) {
    for (const double value : {anchor->latitude_deg, anchor->longitude_deg, anchor->height_m}) hasher->Add(value);
    hasher->Add(anchor->enu_from_world);
  }
  if (!HasParts(map)) return;
  hasher->AddCount(map.components().size());
  for (const auto& [id, component] : map.components()) {
    hasher->Add(id);
    hasher->Add(component.session);
    Add(component.world_from_component, hasher);
    if (!component.joined) continue;
    hasher->Add(component.joined->into);
    Add(component.joined->into_from_component, hasher);
  }
}

void AddFeatures(const map::KeyframeFeatures& features, DigestHasher* hasher) {
  hasher->AddCount(features.features.size());
  for (const image::Keypoint& keypoint : features.features.keypoints) {
    for (const float value : {keypoint.x_px, keypoint.y_px, keypoint.angle_rad}) hasher->Add(value);
    hasher->Add(keypoint.octave);
  }
  static_assert(sizeof(image::Descriptor) == 4 * sizeof(std::uint64_t));
  hasher->AddAll(features.features.descriptors);
  hasher->AddCount(features.words.size());
  hasher->AddAll(features.words);
}

void AddKeyframe(const map::Keyframe& keyframe, const map::KeyframeFeatures& features, DigestHasher* hasher) {
  hasher->Add(keyframe.id);
  hasher->Add(keyframe.session);
  hasher->Add(keyframe.camera);
  hasher->Add(keyframe.time_ns);
  hasher->Add(keyframe.frame_index);
  hasher->Add(keyframe.camera_from_map);
  hasher->Add(keyframe.camera_from_direct);
  hasher->Add(keyframe.direct_segment);
  hasher->Add(keyframe.parent);
  AddFeatures(features, hasher);
  for (const PointId id : keyframe.points) hasher->Add(id);
  hasher->AddCount(keyframe.covisible.size());
  for (const map::CovisibilityEdge& edge : keyframe.covisible) {
    hasher->Add(edge.keyframe);
    hasher->Add(edge.shared_points);
  }
}

void AddHeads(const map::Snapshot& map, DigestHasher* hasher) {
  AddInfo(map, hasher);
  hasher->AddCount(map.cameras().size());
  for (const auto& [id, camera] : map.cameras()) {
    hasher->Add(id);
    hasher->Add(camera.name);
    hasher->Add(CameraModelName(camera.model.model));
    hasher->Add(camera.model.Intrinsics());
    hasher->AddCount(camera.model.distortion.size());
    for (const double value : camera.model.distortion) hasher->Add(value);
    hasher->Add(camera.pinhole);
    if (camera.lens) {
      for (const double value : {camera.lens->focal_scale, camera.lens->k1, camera.lens->k2}) hasher->Add(value);
    }
  }
  hasher->AddCount(map.sessions().size());
  for (const auto& [id, session] : map.sessions()) {
    hasher->Add(id);
    hasher->Add(session.camera);
    hasher->Add(session.source);
    hasher->Add(session.first_ns);
    hasher->Add(session.last_ns);
    hasher->Add(session.complete);
    if (session.removed) hasher->Add(session.removed);
  }
}

}  // namespace

ContentDigester::ContentDigester(const map::Snapshot& heads, std::size_t num_keyframes)
    : has_parts_(HasParts(heads)), hasher_(std::make_unique<DigestHasher>()) {
  AddHeads(heads, hasher_.get());
  hasher_->AddCount(num_keyframes);
}

ContentDigester::~ContentDigester() = default;

void ContentDigester::Add(const map::Keyframe& keyframe, const map::KeyframeFeatures& features) {
  AddKeyframe(keyframe, features, hasher_.get());
  if (has_parts_) hasher_->Add(keyframe.component);
}

void ContentDigester::BeginPoints(std::size_t num_points) { hasher_->AddCount(num_points); }

void ContentDigester::Add(const map::MapPoint& point) {
  hasher_->Add(point.id);
  hasher_->Add(point.position);
  hasher_->Add(point.reference.keyframe);
  hasher_->Add(point.times_visible);
  hasher_->Add(point.times_found);
}

std::string ContentDigester::Finish() { return hasher_->Digest(); }

std::string ContentDigest(const map::Snapshot& snapshot) {
  ContentDigester digester(snapshot, snapshot.keyframes().size());
  snapshot.keyframes().ForEach([&](const auto& keyframe) { digester.Add(*keyframe, *keyframe->features.Get()); });
  digester.BeginPoints(snapshot.points().size());
  snapshot.points().ForEach([&](const auto& point) { digester.Add(*point); });
  return digester.Finish();
}

namespace {

// Reads the rows of keyframes, of their features and of their points side by side, as all are in the order of the same
// ids, and their neighbours by looking them up.
class RowDigest {
 public:
  explicit RowDigest(Database* database) : database_(database) {}

  absl::StatusOr<std::string> Run() {
    MapReader reader(database_, DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    CAIRN_RETURN_IF_ERROR(reader.ReadDescription());
    map_row_ = reader.map_row();
    format_ = reader.format();
    CAIRN_ASSIGN_OR_RETURN(heads_, reader.Assemble());
    if (map_row_.keyframe_count < 0 || map_row_.point_count < 0) return Damaged(kMapTable, 1, "a count is negative");
    observed_.resize(map_row_.next_point.value());
    ContentDigester digester(*heads_, static_cast<std::size_t>(map_row_.keyframe_count));
    CAIRN_RETURN_IF_ERROR(AddKeyframes(&digester));
    digester.BeginPoints(static_cast<std::size_t>(map_row_.point_count));
    CAIRN_RETURN_IF_ERROR(AddPoints(&digester));
    return digester.Finish();
  }

 private:
  static absl::Status Damaged(const TableSpec& table, std::int64_t id, absl::string_view message) {
    return DamagedBy({std::string(table.name), id, std::string(message)});
  }
  absl::StatusOr<Statement> InOrder(const TableSpec& table) {
    return database_->Prepare(table.SelectSql(absl::StrCat("ORDER BY ", table.columns[0]), format_));
  }

  absl::Status AddKeyframes(ContentDigester* digester) {
    CAIRN_ASSIGN_OR_RETURN(Statement keyframes, InOrder(kKeyframesTable));
    CAIRN_ASSIGN_OR_RETURN(Statement features, InOrder(kFeaturesTable));
    CAIRN_ASSIGN_OR_RETURN(Statement points, InOrder(kKeyframePointsTable));
    CAIRN_ASSIGN_OR_RETURN(neighbours_, database_->Prepare(kCovisibilityTable.SelectSql(
                                            "WHERE keyframe_a = ?1 OR keyframe_b = ?1", format_)));
    CAIRN_ASSIGN_OR_RETURN(num_words_, ReadNumWords(database_));
    std::int64_t count = 0, edges = 0;
    Row row;
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, keyframes.Step());
      CAIRN_RETURN_IF_ERROR(StepTo(found ? keyframes.Int(0) : 0, kFeaturesTable, &features));
      CAIRN_RETURN_IF_ERROR(StepTo(found ? keyframes.Int(0) : 0, kKeyframePointsTable, &points));
      if (!found) break;
      const std::int64_t id = keyframes.Int(0);
      map::Keyframe keyframe;
      if (const absl::Status status = ReadChecked(keyframes, &row, &keyframe); !status.ok()) {
        return Damaged(kKeyframesTable, id, status.message());
      }
      CAIRN_RETURN_IF_ERROR(AddNeighbours(&keyframe));
      CAIRN_RETURN_IF_ERROR(AddKeyframe(features, points, &keyframe, digester));
      ++count;
      edges += static_cast<std::int64_t>(keyframe.covisible.size());
    }
    if (count != map_row_.keyframe_count) return Damaged(kKeyframesTable, 0, "there are too few or too many rows");
    // Each was found from both of its ends.
    if (edges != 2 * map_row_.covisibility_count) {
      return Damaged(kCovisibilityTable, 0, "there are too few or too many rows, or a keyframe of one is missing");
    }
    return absl::OkStatus();
  }

  // To the row of this id, which must be the next; 0: to the end, which must be there.
  absl::Status StepTo(std::int64_t id, const TableSpec& table, Statement* rows) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows->Step());
    if (found == (id != 0) && (!found || rows->Int(0) == id)) return absl::OkStatus();
    return Damaged(table, found ? rows->Int(0) : 0, "it does not have a row for each keyframe, and no other");
  }

  absl::Status AddNeighbours(map::Keyframe* keyframe) {
    neighbours_.Bind(1, static_cast<std::int64_t>(keyframe->id.value()));
    Row row;
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, neighbours_.Step());
      if (!found) break;
      EdgeRow edge;
      if (const absl::Status status = ReadChecked(neighbours_, &row, &edge); !status.ok()) {
        return Damaged(kCovisibilityTable, neighbours_.Int(0), status.message());
      }
      keyframe->covisible.push_back({edge.a == keyframe->id ? edge.b : edge.a, edge.shared_points});
    }
    SortCovisible(keyframe);
    return absl::OkStatus();
  }

  absl::Status AddKeyframe(const Statement& features_row, const Statement& points_row, map::Keyframe* keyframe,
                           ContentDigester* digester) {
    const std::int64_t id = keyframe->id.value();
    const auto camera = heads_->cameras().find(keyframe->camera);
    if (camera == heads_->cameras().end()) return Damaged(kKeyframesTable, id, "its camera is missing");
    const auto features =
        FeaturesFromRow(features_row, &camera->second.pinhole, map_row_.info.orb.num_levels, num_words_);
    if (!features.ok()) return Damaged(kFeaturesTable, id, features.status().message());
    auto points = PointIdsFromRow(points_row, features->features.size());
    if (!points.ok()) return Damaged(kKeyframePointsTable, id, points.status().message());
    keyframe->points = *std::move(points);
    for (const PointId point : keyframe->points) {
      if (!point) continue;
      if (point.value() >= observed_.size()) {
        return Damaged(kKeyframePointsTable, id, absl::StrCat("point ", point.value(), " is missing"));
      }
      observed_[point.value()] = true;
    }
    digester->Add(*keyframe, *features);
    return absl::OkStatus();
  }

  absl::Status AddPoints(ContentDigester* digester) {
    CAIRN_ASSIGN_OR_RETURN(Statement rows, InOrder(kPointsTable));
    std::int64_t count = 0;
    Row row;
    map::MapPoint point;
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
      if (!found) break;
      PointRow value;
      if (const absl::Status status = ReadChecked(rows, &row, &value); !status.ok()) {
        return Damaged(kPointsTable, rows.Int(0), status.message());
      }
      if (value.id.value() >= observed_.size() || !observed_[value.id.value()]) {
        return Damaged(kPointsTable, value.id.value(), "no keyframe observes it");
      }
      observed_[value.id.value()] = false;
      SetFromRow(value, &point);
      digester->Add(point);
      ++count;
    }
    if (count != map_row_.point_count) return Damaged(kPointsTable, 0, "there are too few or too many rows");
    for (std::size_t id = 0; id < observed_.size(); ++id) {
      if (observed_[id]) return Damaged(kPointsTable, static_cast<std::int64_t>(id), "the row is missing");
    }
    return absl::OkStatus();
  }

  Database* database_;
  std::int64_t format_ = 0;
  MapRow map_row_;
  std::shared_ptr<const map::Snapshot> heads_;
  std::optional<std::uint32_t> num_words_;
  Statement neighbours_;
  std::vector<bool> observed_;  // by id: points that keyframes have named
};

}  // namespace

bool CanGoByRows(std::int64_t format, const MapRow& map_row) {
  constexpr std::uint64_t kMostIdsPerPoint = 1024, kAlwaysFine = 1 << 23;
  const auto points = static_cast<std::uint64_t>(std::max<std::int64_t>(0, map_row.point_count));
  return format >= 4 && map_row.next_point.value() / kMostIdsPerPoint <= points + kAlwaysFine / kMostIdsPerPoint;
}

absl::StatusOr<std::string> DigestOfRows(Database* database) { return RowDigest(database).Run(); }

}  // namespace cairn::store
