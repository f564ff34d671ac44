#include "store/map_overview.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <unordered_map>
#include <utility>

#include "store/file_paths.h"
#include "store/log_damage.h"
#include "store/map_open.h"
#include "store/map_reader.h"
#include "store/ready_pages.h"
#include "store/ready_summary.h"
#include "store/sqlite.h"
#include "store/tables.h"

namespace cairn::store {
namespace {

constexpr int kSampledPoints = 128;  // whose rows are looked at for their length

// SQLite's record format ("Database File Format", sections 1.5 and 2.1): the type codes in front of the values, and
// the values.
std::int64_t VarintBytes(std::uint64_t value) {
  std::int64_t bytes = 1;
  while ((value >>= 7) != 0 && bytes < 9) ++bytes;
  return bytes;
}

std::int64_t IntegerBytes(std::int64_t value) {
  if (value == 0 || value == 1) return 0;
  const std::uint64_t size = value < 0 ? ~static_cast<std::uint64_t>(value) : static_cast<std::uint64_t>(value);
  if (size < 1ull << 7) return 1;
  if (size < 1ull << 15) return 2;
  if (size < 1ull << 23) return 3;
  if (size < 1ull << 31) return 4;
  return size < 1ull << 47 ? 6 : 8;
}

// What the current row of a statement takes in the file: the first column is the row's number.
std::int64_t RowBytes(const Statement& row) {
  std::int64_t header = 1, values = 0;
  for (int i = 0; i < row.num_columns(); ++i) {
    std::int64_t size = 0;
    switch (row.ColumnType(i)) {
      case Statement::Type::kNull:
        break;
      case Statement::Type::kInteger:
        size = i == 0 ? 0 : IntegerBytes(row.Int(i));
        break;
      case Statement::Type::kReal:
        size = 8;
        break;
      case Statement::Type::kText:
      case Statement::Type::kBlob:
        size = static_cast<std::int64_t>(row.Blob(i).size());
        header += VarintBytes(12 + 2 * static_cast<std::uint64_t>(size)) - 1;
        break;
    }
    ++header;
    values += size;
  }
  constexpr std::int64_t kCellPointer = 2;
  const std::int64_t number = VarintBytes(static_cast<std::uint64_t>(row.Int(0)));
  return kCellPointer + number + VarintBytes(static_cast<std::uint64_t>(header + values)) + header + values;
}

// Sums over what was looked at.
struct Sums {
  std::int64_t rows = 0;
  std::int64_t bytes = 0;
  void Add(std::int64_t b) {
    ++rows;
    bytes += b;
  }
  std::int64_t For(std::int64_t all) const { return rows == 0 ? 0 : std::llround(1.0 * bytes * all / rows); }
};

// One overview in the making, inside a read transaction.
class OverviewReader {
 public:
  OverviewReader(Database* database, const OverviewOptions& options) : database_(database), options_(options) {}

  absl::StatusOr<MapOverview> Read() {
    MapReader reader(database_, DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    CAIRN_RETURN_IF_ERROR(reader.ReadDescription());
    format_ = reader.format();
    overview_.cameras = reader.content().cameras;
    overview_.sessions = reader.content().sessions;
    overview_.components = reader.content().components;
    Summarize(reader.map_row());
    if (auto ready = ReadReadySummary(database_, reader.map_row().revision)) {
      overview_.shares = std::move(ready->shares);
    } else {
      CAIRN_ASSIGN_OR_RETURN(overview_.shares, CountShares(database_, format_));
    }
    CAIRN_RETURN_IF_ERROR(Sample());
    CAIRN_RETURN_IF_ERROR(MeasureErrors());
    CAIRN_RETURN_IF_ERROR(ListParts(reader.map_row()));
    return std::move(overview_);
  }

 private:
  void Summarize(const MapRow& row) {
    MapSummary& summary = overview_.summary;
    summary.format_version = static_cast<int>(format_);
    summary.revision = row.revision;
    summary.info = row.info;
    summary.keyframes = row.keyframe_count;
    summary.points = row.point_count;
    summary.covisibility_edges = row.covisibility_count;
    summary.cameras = static_cast<std::int64_t>(overview_.cameras.size());
    summary.sessions = static_cast<std::int64_t>(overview_.sessions.size());
    summary.components = static_cast<std::int64_t>(overview_.components.size());
  }

  // At most so many ids of a table, spread evenly over those there are.
  absl::StatusOr<std::vector<std::int64_t>> SpreadIds(const std::string& table, const std::string& key,
                                                      std::int64_t count, int most) {
    std::vector<std::int64_t> ids;
    if (count <= most) {
      CAIRN_ASSIGN_OR_RETURN(Statement rows,
                             database_->Prepare(absl::StrCat("SELECT ", key, " FROM ", table, " ORDER BY ", key)));
      while (true) {
        CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
        if (!found) return ids;
        ids.push_back(rows.Int(0));
      }
    }
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t first,
                           database_->QueryInt(absl::StrCat("SELECT min(", key, ") FROM ", table)));
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t last,
                           database_->QueryInt(absl::StrCat("SELECT max(", key, ") FROM ", table)));
    CAIRN_ASSIGN_OR_RETURN(Statement next, database_->Prepare(absl::StrCat("SELECT ", key, " FROM ", table, " WHERE ",
                                                                           key, " >= ?1 ORDER BY ", key, " LIMIT 1")));
    for (int i = 0; i < most; ++i) {
      next.Bind(1, first + (last - first) * i / std::max(1, most - 1));
      CAIRN_ASSIGN_OR_RETURN(const bool found, next.Step());
      if (found && (ids.empty() || ids.back() < next.Int(0))) ids.push_back(next.Int(0));
      next.Reset();
    }
    return ids;
  }

  absl::Status Sample() {
    const std::int64_t count = overview_.summary.keyframes;
    CAIRN_ASSIGN_OR_RETURN(sample_, SpreadIds("keyframe_features", "keyframe", count, options_.sampled_keyframes));
    CAIRN_ASSIGN_OR_RETURN(Statement features,
                           database_->Prepare("SELECT feature_count, length(keypoints), length(descriptors), "
                                              "length(words) FROM keyframe_features WHERE keyframe = ?1"));
    CAIRN_ASSIGN_OR_RETURN(Statement points,
                           database_->Prepare(kKeyframePointsTable.SelectSql("WHERE keyframe = ?1", format_)));
    CAIRN_ASSIGN_OR_RETURN(Statement neighbours,
                           database_->Prepare(absl::StrCat(
                               "SELECT (SELECT count(*) FROM covisibility WHERE keyframe_a = ?1 AND shared_points >= ",
                               map::kMinCovisiblePoints,
                               ") + (SELECT count(*) FROM covisibility WHERE keyframe_b = ?1 AND shared_points >= ",
                               map::kMinCovisiblePoints, ")")));
    CAIRN_ASSIGN_OR_RETURN(Statement rows, database_->Prepare(kKeyframesTable.SelectSql("WHERE id = ?1", format_)));
    std::int64_t num_features = 0, num_points = 0, num_neighbours = 0;
    for (const std::int64_t id : sample_) {
      features.Bind(1, id);
      CAIRN_ASSIGN_OR_RETURN(const bool found, features.Step());
      if (!found) return DamagedBy({"keyframe_features", id, "it is missing"});
      const std::int64_t n = features.Int(0);
      num_features += n;
      keypoints_.Add(features.Int(1));
      descriptors_.Add(features.Int(2));
      words_.Add(features.Int(3));
      features.Reset();
      points.Bind(1, id);
      CAIRN_ASSIGN_OR_RETURN(const bool has_points, points.Step());
      if (!has_points) return DamagedBy({"keyframe_points", id, "it is missing"});
      const auto point_ids = PointIdsFromRow(points, static_cast<std::size_t>(std::max<std::int64_t>(0, n)));
      if (!point_ids.ok()) return DamagedBy({"keyframe_points", id, std::string(point_ids.status().message())});
      num_points += std::ranges::count_if(*point_ids, [](PointId point) { return point.valid(); });
      point_ids_.Add(RowBytes(points));
      points.Reset();
      neighbours.Bind(1, id);
      CAIRN_ASSIGN_OR_RETURN(const bool counted, neighbours.Step());
      num_neighbours += counted ? neighbours.Int(0) : 0;
      neighbours.Reset();
      rows.Bind(1, id);
      CAIRN_ASSIGN_OR_RETURN(const bool has_row, rows.Step());
      if (!has_row) return DamagedBy({"keyframes", id, "it is missing"});
      rows_.Add(RowBytes(rows));
      rows.Reset();
    }
    MapQuality& quality = overview_.quality;
    quality.keyframes = static_cast<std::int64_t>(sample_.size());
    quality.all = quality.keyframes == count;
    const double looked_at = std::max<double>(1.0, static_cast<double>(sample_.size()));
    quality.features = static_cast<double>(num_features) / looked_at;
    quality.points = static_cast<double>(num_points) / looked_at;
    quality.covisible = static_cast<double>(num_neighbours) / looked_at;
    if (overview_.summary.points > 0) {
      quality.observations_per_point =
          quality.points * static_cast<double>(count) / static_cast<double>(overview_.summary.points);
    }
    return absl::OkStatus();
  }

  // Reprojection errors of the observations in a few keyframes.
  absl::Status MeasureErrors() {
    CAIRN_ASSIGN_OR_RETURN(Statement keyframes,
                           database_->Prepare(kKeyframesTable.SelectSql("WHERE id = ?1", format_)));
    CAIRN_ASSIGN_OR_RETURN(Statement features,
                           database_->Prepare(kFeaturesTable.SelectSql("WHERE keyframe = ?1", format_)));
    CAIRN_ASSIGN_OR_RETURN(Statement links,
                           database_->Prepare(kKeyframePointsTable.SelectSql("WHERE keyframe = ?1", format_)));
    CAIRN_ASSIGN_OR_RETURN(Statement points, database_->Prepare("SELECT x, y, z FROM points WHERE id = ?1"));
    std::vector<double> errors;
    const std::size_t count = std::min(sample_.size(), static_cast<std::size_t>(options_.error_keyframes));
    for (std::size_t k = 0; k < count; ++k) {
      const std::int64_t id = sample_[k * sample_.size() / count];
      CAIRN_RETURN_IF_ERROR(ErrorsOf(id, &keyframes, &features, &links, &points, &errors));
    }
    MapQuality& quality = overview_.quality;
    quality.error_keyframes = static_cast<std::int64_t>(count);
    if (errors.empty()) return absl::OkStatus();
    double sum = 0.0;
    for (const double error : errors) sum += error * error;
    quality.error_rms_px = std::sqrt(sum / static_cast<double>(errors.size()));
    const auto middle = errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2);
    std::nth_element(errors.begin(), middle, errors.end());
    quality.error_median_px = *middle;
    return absl::OkStatus();
  }

  absl::Status ErrorsOf(std::int64_t id, Statement* keyframes, Statement* features, Statement* links, Statement* points,
                        std::vector<double>* errors) {
    keyframes->Bind(1, id);
    features->Bind(1, id);
    links->Bind(1, id);
    CAIRN_ASSIGN_OR_RETURN(const bool is_keyframe, keyframes->Step());
    CAIRN_ASSIGN_OR_RETURN(const bool has_features, features->Step());
    CAIRN_ASSIGN_OR_RETURN(const bool has_links, links->Step());
    if (!is_keyframe || !has_features || !has_links) return DamagedBy({"keyframes", id, "a part of it is missing"});
    map::Keyframe keyframe;
    if (const absl::Status read = FromRow(*keyframes, &keyframe); !read.ok()) {
      return DamagedBy({"keyframes", id, std::string(read.message())});
    }
    const auto camera = std::ranges::find(overview_.cameras, keyframe.camera, &map::MapCamera::id);
    if (camera == overview_.cameras.end()) return DamagedBy({"keyframes", id, "its camera is missing"});
    const auto read = FeaturesFromRow(*features, &camera->pinhole, overview_.summary.info.orb.num_levels, std::nullopt);
    if (!read.ok()) return DamagedBy({"keyframe_features", id, std::string(read.status().message())});
    const auto ids = PointIdsFromRow(*links, read->features.size());
    if (!ids.ok()) return DamagedBy({"keyframe_points", id, std::string(ids.status().message())});
    for (std::size_t i = 0; i < ids->size(); ++i) {
      if (!(*ids)[i]) continue;
      points->Bind(1, static_cast<std::int64_t>((*ids)[i].value()));
      CAIRN_ASSIGN_OR_RETURN(const bool is_point, points->Step());
      if (!is_point) return DamagedBy({"keyframe_points", id, "a point is missing"});
      const Vector3d point_c = keyframe.camera_from_map * Vector3d(points->Real(0), points->Real(1), points->Real(2));
      const image::Keypoint& keypoint = read->features.keypoints[i];
      if (point_c.z() > 0.0) {
        errors->push_back((camera->pinhole.Project(point_c) - Vector2d(keypoint.x_px, keypoint.y_px)).norm());
      }
      points->Reset();
    }
    for (Statement* statement : {keyframes, features, links}) statement->Reset();
    return absl::OkStatus();
  }

  absl::StatusOr<std::int64_t> PointBytes() {
    CAIRN_ASSIGN_OR_RETURN(const auto ids, SpreadIds("points", "id", overview_.summary.points, kSampledPoints));
    CAIRN_ASSIGN_OR_RETURN(Statement rows, database_->Prepare(kPointsTable.SelectSql("WHERE id = ?1", format_)));
    Sums sums;
    for (const std::int64_t id : ids) {
      rows.Bind(1, id);
      CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
      if (found) sums.Add(RowBytes(rows));
      rows.Reset();
    }
    return sums.For(overview_.summary.points);
  }

  // Of the ready pages; of those of keyframes and points some stand for all.
  absl::StatusOr<std::int64_t> ReadyBytes(const MapRow& row) {
    constexpr std::uint32_t kSampled = 64;
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t tables,
                           database_->QueryInt("SELECT count(*) FROM sqlite_master WHERE name = 'ready_pages'"));
    if (tables == 0) return 0;
    CAIRN_ASSIGN_OR_RETURN(std::int64_t bytes,
                           database_->QueryInt(absl::StrCat(
                               "SELECT coalesce(sum(length(bytes)), 0) FROM ready_pages WHERE id = 0 OR id >= ",
                               ReadyRowId(ReadyKind::kPlaces, 0))));
    CAIRN_ASSIGN_OR_RETURN(Statement page, database_->Prepare("SELECT length(bytes) FROM ready_pages WHERE id = ?"));
    const std::pair<ReadyKind, std::uint32_t> kinds[] = {
        {ReadyKind::kKeyframes, row.next_keyframe.value() / kKeyframesPerPage + 1},
        {ReadyKind::kPoints, row.next_point.value() / kPointsPerPage + 1}};
    for (const auto& [kind, pages] : kinds) {
      const std::uint32_t step = (pages + kSampled - 1) / kSampled;
      std::int64_t sum = 0, looked = 0;
      for (std::uint32_t number = 0; number < pages; number += step, ++looked) {
        page.Bind(1, ReadyRowId(kind, number));
        CAIRN_ASSIGN_OR_RETURN(const bool found, page.Step());
        if (found) sum += page.Int(0);
        page.Reset();
      }
      bytes += sum * pages / std::max<std::int64_t>(1, looked);
    }
    return bytes;
  }

  absl::Status ListParts(const MapRow& row) {
    MapSummary& summary = overview_.summary;
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t pages, database_->QueryInt("PRAGMA page_count"));
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t page_bytes, database_->QueryInt("PRAGMA page_size"));
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t free_pages, database_->QueryInt("PRAGMA freelist_count"));
    CAIRN_ASSIGN_OR_RETURN(summary.vocabulary_bytes,
                           database_->QueryInt("SELECT coalesce(sum(length(bytes)), 0) FROM vocabulary"));
    std::int64_t log_bytes = 0;
    CAIRN_ASSIGN_OR_RETURN(log_bytes, database_->QueryInt("SELECT coalesce(sum(length(reason) + 40), 0) FROM changes"));
    if (format_ >= 4) {
      CAIRN_ASSIGN_OR_RETURN(const std::int64_t touched,
                             database_->QueryInt("SELECT coalesce(sum(length(ids) + 20), 0) FROM touched"));
      log_bytes += touched;
    }
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t point_bytes, PointBytes());
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t ready_bytes, ReadyBytes(row));
    summary.file_bytes = pages * page_bytes;
    overview_.has_vocabulary = summary.vocabulary_bytes > 0;
    // Row and index: two pairs of ids, a count, a checksum.
    constexpr std::int64_t kCovisibilityBytes = 17 + 9;
    const std::int64_t keyframes = summary.keyframes;
    std::vector<MapPart> parts = {{"vocabulary", summary.vocabulary_bytes},
                                  {"keypoints", keypoints_.For(keyframes)},
                                  {"descriptors", descriptors_.For(keyframes)},
                                  {"words", words_.For(keyframes)},
                                  {"links to points", point_ids_.For(keyframes)},
                                  {"poses", rows_.For(keyframes)},
                                  {"points", point_bytes},
                                  {"covisibility", summary.covisibility_edges * kCovisibilityBytes},
                                  {"ready to be queried", ready_bytes},
                                  {"log of changes", log_bytes},
                                  {"free", free_pages * page_bytes}};
    std::int64_t known = 0;
    for (const MapPart& part : parts) known += part.bytes;
    // Pages that are not full, what links them, the rows of small tables.
    parts.push_back({"rest", std::max<std::int64_t>(0, summary.file_bytes - known)});
    std::ranges::stable_sort(parts, std::ranges::greater(), &MapPart::bytes);
    overview_.parts = std::move(parts);
    return absl::OkStatus();
  }

  Database* database_;
  const OverviewOptions options_;
  std::int64_t format_ = 0;
  MapOverview overview_;
  std::vector<std::int64_t> sample_;  // ids of keyframes
  Sums keypoints_, descriptors_, words_, point_ids_, rows_;
};

// What only a loaded map knows, of formats that do not tell.
void TakeComponents(const map::Snapshot& map, MapOverview* overview) {
  overview->components.clear();
  for (const auto& [id, component] : map.components()) overview->components.push_back(component);
  overview->summary.components = static_cast<std::int64_t>(overview->components.size());
  std::map<std::pair<SessionId, ComponentId>, KeyframeShare> shares;
  map.keyframes().ForEach([&](const auto& keyframe) {
    KeyframeShare& share = shares[{keyframe->session, keyframe->component}];
    if (share.keyframes++ == 0) {
      share = {keyframe->session, keyframe->component, 1, keyframe->time_ns, keyframe->time_ns};
    }
    share.first_ns = std::min(share.first_ns, keyframe->time_ns);
    share.last_ns = std::max(share.last_ns, keyframe->time_ns);
  });
  overview->shares.clear();
  for (const auto& [key, share] : shares) overview->shares.push_back(share);
}

absl::StatusOr<MapOverview> ReadResolved(const std::string& uri, const OverviewOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveExisting(uri));
  std::string immutable_stamp;
  const std::string log_damage = LogDamageOf(resolved);
  CAIRN_ASSIGN_OR_RETURN(const auto database, OpenForReading(resolved, &immutable_stamp));
  CAIRN_RETURN_IF_ERROR(CheckSchema(database.get(), /*views=*/false, DamagedBy));
  CAIRN_ASSIGN_OR_RETURN(const Transaction transaction, Transaction::Begin(database.get(), Transaction::Kind::kRead));
  auto overview = OverviewReader(database.get(), options).Read();
  if (overview.ok() && !log_damage.empty()) overview->notes.push_back(log_damage);
  if (const std::string note = LeftoverNote(resolved, /*writing=*/false); overview.ok() && !note.empty()) {
    overview->notes.push_back(note);
  }
  if (overview.ok() && !immutable_stamp.empty() && immutable_stamp != FileStamp(resolved)) {
    return MakeFault(Fault::kBusy, "it was written while it was read; open it again");
  }
  return overview;
}

}  // namespace

absl::StatusOr<MapOverview> ReadMapOverview(const std::string& uri, const OverviewOptions& options) {
  auto overview = ReadResolved(uri, options);
  if (!overview.ok()) return Annotate(overview.status(), absl::StrCat("map ", uri));
  if (overview->summary.format_version < 4) {
    CAIRN_ASSIGN_OR_RETURN(const auto store, OpenMapStore(uri, OpenMode::kRead));
    CAIRN_ASSIGN_OR_RETURN(const auto map, store->LoadSnapshot());
    TakeComponents(*map, &*overview);
  }
  return overview;
}

}  // namespace cairn::store
