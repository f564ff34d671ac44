#include "store/feature_reader.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "store/blobs.h"
#include "store/fault.h"
#include "store/map_open.h"
#include "store/map_reader.h"
#include "store/row.h"
#include "store/sqlite.h"
#include "store/tables.h"

namespace cairn::store {
namespace {

class SqliteFeatureReader : public map::FeatureReader {
 public:
  SqliteFeatureReader(std::string path, std::string resolved)
      : path_(std::move(path)), resolved_(std::move(resolved)) {}

  absl::Status Open(const FileIdentity& identity) {
    CAIRN_ASSIGN_OR_RETURN(database_, OpenForReading(resolved_, &immutable_stamp_));
    if (!identity.IsAt(resolved_))
      return MakeFault(Fault::kMoved, "it was replaced while it was opened; open it again");
    return Prepare(database_.get());
  }

  absl::Status Prepare(Database* database) {
    CAIRN_ASSIGN_OR_RETURN(num_words_, ReadNumWords(database));
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t levels, database->QueryInt("SELECT orb_num_levels FROM map"));
    num_levels_ = static_cast<int>(levels);
    connection_ = database;
    CAIRN_ASSIGN_OR_RETURN(revision_, database->QueryInt("SELECT revision FROM map"));
    CAIRN_ASSIGN_OR_RETURN(format_, database->QueryInt("PRAGMA user_version"));
    CAIRN_ASSIGN_OR_RETURN(select_, database->Prepare(kFeaturesTable.SelectSql("WHERE keyframe = ?", format_)));
    return absl::OkStatus();
  }

  absl::StatusOr<std::shared_ptr<const map::KeyframeFeatures>> Read(KeyframeId keyframe) override {
    auto read = ReadRow(keyframe);
    select_.Reset();
    if (!read.ok()) return Annotate(read.status(), absl::StrCat("map ", path_));
    return read;
  }

 private:
  absl::StatusOr<std::shared_ptr<const map::KeyframeFeatures>> ReadRow(KeyframeId keyframe) {
    select_.Bind(1, static_cast<std::int64_t>(keyframe.value()));
    CAIRN_ASSIGN_OR_RETURN(const bool found, select_.Step());
    if (!found) return WhyMissing(keyframe);
    auto features = FeaturesFromRow(select_, /*camera=*/nullptr, num_levels_, num_words_);
    if (!features.ok()) {
      return DamagedBy({std::string(kFeaturesTable.name), keyframe.value(), std::string(features.status().message())});
    }
    if (!immutable_stamp_.empty() && FileStamp(resolved_) != immutable_stamp_) {
      return MakeFault(Fault::kBusy, "it was written while it was read; open it again");
    }
    return std::make_shared<const map::KeyframeFeatures>(*std::move(features));
  }

  // Null if the keyframe has left the map since, which the changes say; that a row is not found where it should be is
  // damage, and no reason to answer without it.
  absl::StatusOr<std::shared_ptr<const map::KeyframeFeatures>> WhyMissing(KeyframeId keyframe) {
    const std::int64_t id = keyframe.value();
    const auto damaged = DamagedBy({std::string(kFeaturesTable.name), id, "no row for the keyframe"});
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t there,
                           connection_->QueryInt(absl::StrCat("SELECT count(*) FROM keyframes WHERE id = ", id)));
    if (there != 0) return damaged;
    if (format_ < 4) return nullptr;
    CAIRN_ASSIGN_OR_RETURN(Statement rows,
                           connection_->Prepare("SELECT ids_checksum, ids FROM touched WHERE kind = 'keyframes'"));
    std::vector<std::uint32_t> ids;
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
      if (!found) break;
      ids.clear();
      if (rows.Int(0) != BlobChecksum(rows.Blob(1))) continue;
      UnpackIdRuns(rows.Blob(1), std::numeric_limits<std::uint32_t>::max(), &ids).IgnoreError();
      if (std::ranges::binary_search(ids, keyframe.value())) return nullptr;
    }
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t revision, connection_->QueryInt("SELECT revision FROM map"));
    if (revision == revision_) return damaged;
    return MakeFault(Fault::kBusy, "much of it was written while it was read; open it again");
  }

  const std::string path_, resolved_;
  std::string immutable_stamp_;
  std::unique_ptr<Database> database_;      // null: somebody else's
  Database* connection_ = nullptr;          // the one that is used
  std::int64_t revision_ = 0, format_ = 0;  // when it was opened
  std::optional<std::uint32_t> num_words_;
  int num_levels_ = 0;
  Statement select_;  // after the database: it goes first
};

}  // namespace

absl::StatusOr<std::unique_ptr<map::FeatureReader>> OpenFeatureReader(const std::string& path,
                                                                      const std::string& resolved,
                                                                      const FileIdentity& identity) {
  auto reader = std::make_unique<SqliteFeatureReader>(path, resolved);
  CAIRN_RETURN_IF_ERROR(reader->Open(identity));
  return reader;
}

absl::StatusOr<std::unique_ptr<map::FeatureReader>> FeatureReaderWithin(Database* database, const std::string& path) {
  auto reader = std::make_unique<SqliteFeatureReader>(path, "");
  CAIRN_RETURN_IF_ERROR(reader->Prepare(database));
  return reader;
}

}  // namespace cairn::store
