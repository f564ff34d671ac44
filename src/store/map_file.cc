#include "store/map_file.h"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <utility>

#include "store/delta_writer.h"
#include "store/digest.h"
#include "store/map_open.h"
#include "store/map_reader.h"
#include "store/migrations.h"
#include "store/sqlite.h"
#include "store/writer_lock.h"

namespace cairn::store {
namespace {

std::int64_t NowUnixNs() {
  using std::chrono::nanoseconds;
  return std::chrono::duration_cast<nanoseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

absl::Status CheckNewInfo(const map::MapInfo& info) {
  const bool is_id = info.id.size() == 32 && std::all_of(info.id.begin(), info.id.end(), [](char c) {
                       return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
                     });
  if (!is_id) return absl::InvalidArgumentError(absl::StrCat("the map id '", info.id, "' is not 32 hex digits"));
  return info.orb.Validate();
}

}  // namespace

int SupportedFormatVersion() { return BuiltInMigrations().back().version; }

MapFile::MapFile(std::string path, std::unique_ptr<Database> database, std::unique_ptr<WriterLock> lock,
                 const WriteOptions& options)
    : path_(std::move(path)), lock_(std::move(lock)), database_(std::move(database)), options_(options) {}

MapFile::~MapFile() {
  if (database_) Close().IgnoreError();
}

absl::StatusOr<std::unique_ptr<MapFile>> MapFile::Create(const std::string& path, const map::MapInfo& info,
                                                         const CreateOptions& options) {
  auto created = [&]() -> absl::StatusOr<std::unique_ptr<MapFile>> {
    CAIRN_RETURN_IF_ERROR(CheckNewInfo(info));
    CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveNew(path));
    CAIRN_ASSIGN_OR_RETURN(auto lock, WriterLock::Acquire(resolved));
    if (!options.overwrite && access(resolved.c_str(), F_OK) == 0) {
      return MakeFault(Fault::kExists, "exists already: choose another name, or ask to overwrite it");
    }
    CAIRN_RETURN_IF_ERROR(WriteNewMap(resolved, info, options.vocabulary));
    return OpenLocked(path, resolved, std::move(lock), options.write);
  }();
  if (!created.ok()) return Annotate(created.status(), absl::StrCat("creating map ", path));
  return created;
}

absl::StatusOr<std::unique_ptr<MapFile>> MapFile::Open(const std::string& path, const WriteOptions& options) {
  auto opened = [&]() -> absl::StatusOr<std::unique_ptr<MapFile>> {
    CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveExisting(path));
    CAIRN_ASSIGN_OR_RETURN(auto lock, WriterLock::Acquire(resolved));
    return OpenLocked(path, resolved, std::move(lock), options);
  }();
  if (!opened.ok()) return Annotate(opened.status(), absl::StrCat("opening map ", path, " for writing"));
  return opened;
}

absl::StatusOr<std::unique_ptr<MapFile>> MapFile::OpenLocked(const std::string& path, const std::string& resolved,
                                                             std::unique_ptr<WriterLock> lock,
                                                             const WriteOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(auto database, Database::OpenFile(resolved, Database::Mode::kReadWrite));
  CAIRN_RETURN_IF_ERROR(CheckIdentity(database.get()));
  CAIRN_RETURN_IF_ERROR(PrepareForWriting(database.get(), options));
  CAIRN_RETURN_IF_ERROR(Migrate(database.get(), BuiltInMigrations()));
  CAIRN_RETURN_IF_ERROR(CheckSchema(database.get(), /*views=*/false, DamagedBy));
  std::unique_ptr<MapFile> file(new MapFile(path, std::move(database), std::move(lock), options));
  CAIRN_ASSIGN_OR_RETURN(file->writer_, DeltaWriter::Prepare(file->database_.get()));
  CAIRN_RETURN_IF_ERROR(file->writer_->ReadMapRow().status());
  return file;
}

absl::StatusOr<std::unique_ptr<MapFile>> MapFile::OpenReadOnly(const std::string& path) {
  auto opened = [&]() -> absl::StatusOr<std::unique_ptr<MapFile>> {
    CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveExisting(path));
    std::string immutable_stamp;
    CAIRN_ASSIGN_OR_RETURN(auto database, OpenForReading(resolved, &immutable_stamp));
    CAIRN_RETURN_IF_ERROR(CheckSchema(database.get(), /*views=*/false, DamagedBy));
    std::unique_ptr<MapFile> file(new MapFile(path, std::move(database), nullptr, {}));
    file->immutable_stamp_ = immutable_stamp;
    MapReader reader(file->database_.get(), DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    return file;
  }();
  if (!opened.ok()) return Annotate(opened.status(), absl::StrCat("opening map ", path));
  return opened;
}

absl::Status MapFile::Close() {
  if (!database_) return absl::OkStatus();
  writer_.reset();
  absl::Status folded;
  if (writable()) folded = database_->Execute("PRAGMA wal_checkpoint(TRUNCATE)");
  const absl::Status closed = database_->Close();
  database_.reset();
  lock_.reset();
  return Annotated(folded.ok() ? closed : folded);
}

absl::Status MapFile::Annotated(const absl::Status& status) const {
  return Annotate(status, absl::StrCat("map ", path_));
}

absl::Status MapFile::RequireWritable() const {
  if (writable()) return absl::OkStatus();
  return absl::FailedPreconditionError("it is open for reading only");
}

absl::Status MapFile::CheckUnchanged() const {
  if (immutable_stamp_.empty() || immutable_stamp_ == FileStamp(path_)) return absl::OkStatus();
  return MakeFault(Fault::kBusy, "it was written while it was read; open it again");
}

absl::Status MapFile::Commit(const map::Delta& delta) {
  CAIRN_RETURN_IF_ERROR(Annotated(RequireWritable()));
  return Annotated(writer_->Commit(delta, options_.record_wall_clock ? NowUnixNs() : 0));
}

absl::StatusOr<std::shared_ptr<const map::Snapshot>> MapFile::LoadSnapshot() {
  auto loaded = [&]() -> absl::StatusOr<std::shared_ptr<const map::Snapshot>> {
    CAIRN_ASSIGN_OR_RETURN(const Transaction transaction,
                           Transaction::Begin(database_.get(), Transaction::Kind::kRead));
    MapReader reader(database_.get(), DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    CAIRN_RETURN_IF_ERROR(reader.ReadEntities());
    CAIRN_ASSIGN_OR_RETURN(auto snapshot, reader.Assemble());
    CAIRN_RETURN_IF_ERROR(CheckUnchanged());
    return snapshot;
  }();
  if (!loaded.ok()) return Annotated(loaded.status());
  return loaded;
}

absl::Status MapFile::PutVocabulary(absl::string_view bytes) {
  const auto put = [&]() -> absl::Status {
    CAIRN_RETURN_IF_ERROR(RequireWritable());
    CAIRN_ASSIGN_OR_RETURN(Transaction transaction, Transaction::Begin(database_.get(), Transaction::Kind::kWrite));
    CAIRN_ASSIGN_OR_RETURN(const MapRow map_row, writer_->ReadMapRow());
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t others,
                           database_->QueryInt(absl::StrCat("SELECT count(*) FROM vocabulary WHERE bytes_checksum != ",
                                                            BlobChecksum(AsBytes(bytes)))));
    if (others > 0 && map_row.keyframe_count > 0) {
      return absl::FailedPreconditionError("its keyframes refer to the words of another vocabulary");
    }
    CAIRN_RETURN_IF_ERROR(WriteVocabulary(database_.get(), bytes));
    return transaction.Commit();
  };
  return Annotated(put());
}

absl::StatusOr<std::string> MapFile::LoadVocabulary() {
  auto loaded = [&]() -> absl::StatusOr<std::string> {
    CAIRN_ASSIGN_OR_RETURN(Statement rows, database_->Prepare(kVocabularyTable.SelectSql("WHERE id = 1")));
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
    if (!found) return absl::NotFoundError("it holds no vocabulary");
    const Bytes bytes = rows.Blob(2);
    if (rows.Int(1) != BlobChecksum(bytes)) return DamagedBy({"vocabulary", 1, "bytes: wrong checksum"});
    CAIRN_RETURN_IF_ERROR(CheckUnchanged());
    return std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  }();
  if (!loaded.ok()) return Annotated(loaded.status());
  return loaded;
}

absl::StatusOr<Revision> MapFile::ReadRevision() {
  const absl::StatusOr<std::int64_t> revision = database_->QueryInt("SELECT revision FROM map");
  if (!revision.ok()) return Annotated(revision.status());
  return static_cast<Revision>(*revision);
}

absl::StatusOr<MapSummary> MapFile::ReadSummary() {
  auto read = [&]() -> absl::StatusOr<MapSummary> {
    CAIRN_ASSIGN_OR_RETURN(const Transaction transaction,
                           Transaction::Begin(database_.get(), Transaction::Kind::kRead));
    MapReader reader(database_.get(), DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    const MapRow& row = reader.map_row();
    MapSummary summary;
    summary.revision = row.revision;
    summary.info = row.info;
    summary.keyframes = row.keyframe_count;
    summary.points = row.point_count;
    summary.covisibility_edges = row.covisibility_count;
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t version, database_->QueryInt("PRAGMA user_version"));
    summary.format_version = static_cast<int>(version);
    CAIRN_ASSIGN_OR_RETURN(summary.cameras, database_->QueryInt("SELECT count(*) FROM cameras"));
    CAIRN_ASSIGN_OR_RETURN(summary.sessions, database_->QueryInt("SELECT count(*) FROM sessions"));
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t pages, database_->QueryInt("PRAGMA page_count"));
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t page_bytes, database_->QueryInt("PRAGMA page_size"));
    summary.file_bytes = pages * page_bytes;
    CAIRN_ASSIGN_OR_RETURN(summary.vocabulary_bytes,
                           database_->QueryInt("SELECT coalesce(sum(length(bytes)), 0) FROM vocabulary"));
    return summary;
  }();
  if (!read.ok()) return Annotated(read.status());
  return read;
}

absl::StatusOr<std::vector<LoggedChange>> MapFile::ReadChanges(int max_count) {
  auto read = [&]() -> absl::StatusOr<std::vector<LoggedChange>> {
    CAIRN_ASSIGN_OR_RETURN(Statement rows,
                           database_->Prepare(kChangesTable.SelectSql("ORDER BY revision DESC LIMIT ?")));
    rows.Bind(1, static_cast<std::int64_t>(std::max(0, max_count)));
    std::vector<LoggedChange> changes;
    Row row;
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
      if (!found) return changes;
      if (!row.ReadWithChecksum(rows)) return DamagedBy({"changes", rows.Int(0), "wrong checksum"});
      CAIRN_RETURN_IF_ERROR(FromRow(rows, &changes.emplace_back()));
    }
  }();
  if (!read.ok()) return Annotated(read.status());
  return read;
}

absl::StatusOr<std::string> MapFile::ContentDigest() {
  CAIRN_ASSIGN_OR_RETURN(const auto snapshot, LoadSnapshot());
  return store::ContentDigest(*snapshot);
}

absl::Status MapFile::Compact() {
  CAIRN_RETURN_IF_ERROR(Annotated(RequireWritable()));
  CAIRN_RETURN_IF_ERROR(Annotated(database_->Execute("VACUUM")));
  return Annotated(database_->Execute("PRAGMA wal_checkpoint(TRUNCATE)"));
}

}  // namespace cairn::store
