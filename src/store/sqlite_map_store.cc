#include "store/sqlite_map_store.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <utility>

#include "store/delta_reader.h"
#include "store/delta_writer.h"
#include "store/digest.h"
#include "store/feature_reader.h"
#include "store/file_paths.h"
#include "store/format_upgrade.h"
#include "store/log_damage.h"
#include "store/map_open.h"
#include "store/map_reader.h"
#include "store/migrations.h"
#include "store/ready_pages.h"
#include "store/sqlite.h"
#include "store/sqlite_record.h"
#include "store/touched_rows.h"
#include "store/write_ahead_log.h"
#include "store/writer_lock.h"

namespace cairn::store {
namespace {

std::int64_t NowUnixNs() {
  using std::chrono::nanoseconds;
  return std::chrono::duration_cast<nanoseconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace

int SupportedFormatVersion() { return BuiltInMigrations().back().version; }

SqliteMapStore::SqliteMapStore(std::string path, std::string resolved, std::unique_ptr<Database> database,
                               FileIdentity identity)
    : path_(std::move(path)),
      resolved_(std::move(resolved)),
      database_(std::move(database)),
      identity_(std::move(identity)) {}

// Who lets go of it without a word is in a hurry.
SqliteMapStore::~SqliteMapStore() {
  if (!database_) return;
  if (writable()) {
    CloseWriting(/*ready=*/false).IgnoreError();
  } else {
    Close().IgnoreError();
  }
}

absl::StatusOr<std::unique_ptr<SqliteMapStore>> SqliteMapStore::Create(const std::string& path,
                                                                       const map::MapInfo& info,
                                                                       const CreateOptions& options) {
  auto created = [&]() -> absl::StatusOr<std::unique_ptr<SqliteMapStore>> {
    CAIRN_RETURN_IF_ERROR(CheckNewInfo(info));
    CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveNew(path));
    CAIRN_RETURN_IF_ERROR(CheckFileSystem(resolved));
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

absl::StatusOr<std::unique_ptr<SqliteMapStore>> SqliteMapStore::Open(const std::string& path,
                                                                     const WriteOptions& options) {
  auto opened = [&]() -> absl::StatusOr<std::unique_ptr<SqliteMapStore>> {
    CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveExisting(path));
    CAIRN_RETURN_IF_ERROR(CheckFileSystem(resolved));
    CAIRN_RETURN_IF_ERROR(CheckOneName(resolved));
    CAIRN_ASSIGN_OR_RETURN(auto lock, WriterLock::Acquire(resolved));
    CAIRN_ASSIGN_OR_RETURN(auto store, OpenLocked(path, resolved, std::move(lock), options));
    store->NoteLeftovers();
    return store;
  }();
  if (!opened.ok()) return Annotate(opened.status(), absl::StrCat("opening map ", path, " for writing"));
  return opened;
}

absl::StatusOr<std::unique_ptr<SqliteMapStore>> SqliteMapStore::OpenLocked(const std::string& path,
                                                                           const std::string& resolved,
                                                                           std::unique_ptr<WriterLock> lock,
                                                                           const WriteOptions& options) {
  CAIRN_RETURN_IF_ERROR(CheckLog(resolved, /*writing=*/true));
  const std::string log_damage = KeepDamagedLog(resolved);
  CAIRN_ASSIGN_OR_RETURN(FileIdentity identity, FileIdentity::Of(resolved));
  CAIRN_ASSIGN_OR_RETURN(auto database, Database::OpenFile(resolved, Database::Mode::kReadWrite));
  CAIRN_RETURN_IF_ERROR(CheckIdentity(database.get()));
  CAIRN_RETURN_IF_ERROR(PrepareForWriting(database.get(), options));
  std::vector<std::string> notes;
  CAIRN_RETURN_IF_ERROR(UpgradeFormat(database.get(), resolved, &notes));
  CAIRN_RETURN_IF_ERROR(database->Execute(std::string(kReadyTableSql)));
  CAIRN_RETURN_IF_ERROR(CheckSchema(database.get(), /*views=*/false, DamagedBy));
  std::unique_ptr<SqliteMapStore> store(new SqliteMapStore(path, resolved, std::move(database), std::move(identity)));
  store->lock_ = std::move(lock);
  store->options_ = options;
  store->notes_ = std::move(notes);
  store->NoteLogDamage(log_damage);
  CAIRN_ASSIGN_OR_RETURN(store->writer_, DeltaWriter::Prepare(store->database_.get()));
  CAIRN_RETURN_IF_ERROR(store->writer_->BeginLog());
  // The token must be in the file before the first change is in the log.
  CAIRN_RETURN_IF_ERROR(store->database_->Execute("PRAGMA wal_checkpoint(TRUNCATE)"));
  CAIRN_ASSIGN_OR_RETURN(const MapRow map_row, store->writer_->ReadMapRow());
  store->log_token_ = map_row.log_token;
  store->previous_log_token_ = map_row.previous_log_token;
  CAIRN_ASSIGN_OR_RETURN(store->log_identity_, FileIdentity::Of(absl::StrCat(resolved, kLogSuffix)));
  CAIRN_RETURN_IF_ERROR(store->CheckInPlace());
  return store;
}

absl::StatusOr<std::unique_ptr<SqliteMapStore>> SqliteMapStore::OpenReadOnly(const std::string& path) {
  auto opened = [&]() -> absl::StatusOr<std::unique_ptr<SqliteMapStore>> {
    CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveExisting(path));
    CAIRN_ASSIGN_OR_RETURN(FileIdentity identity, FileIdentity::Of(resolved));
    std::string immutable_stamp;
    const std::string stamp = FileStamp(resolved);
    const std::string log_damage = LogDamageOf(resolved);
    CAIRN_ASSIGN_OR_RETURN(auto database, OpenForReading(resolved, &immutable_stamp));
    CAIRN_RETURN_IF_ERROR(CheckSchema(database.get(), /*views=*/false, DamagedBy));
    std::unique_ptr<SqliteMapStore> store(new SqliteMapStore(path, resolved, std::move(database), std::move(identity)));
    store->immutable_stamp_ = immutable_stamp;
    store->known_stamp_ = stamp;
    store->NoteLogDamage(log_damage);
    MapReader reader(store->database_.get(), DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    store->map_id_ = reader.map_row().info.id;
    store->NoteLeftovers();
    return store;
  }();
  if (!opened.ok()) return Annotate(opened.status(), absl::StrCat("opening map ", path));
  return opened;
}

void SqliteMapStore::NoteLogDamage(const std::string& damage) {
  log_damage_ = damage;
  if (!damage.empty()) notes_.push_back(damage);
}

void SqliteMapStore::NoteLeftovers() {
  const std::string note = LeftoverNote(resolved_, lock_ != nullptr);
  if (!note.empty()) notes_.push_back(note);
}

absl::Status SqliteMapStore::Close() {
  if (!database_) return absl::OkStatus();
  if (writable()) return Annotated(CloseWriting(options_.ready));
  const absl::Status closed = database_->Close();
  database_.reset();
  return Annotated(closed);
}

bool SqliteMapStore::HasOwnContent() {
  const auto state = ReadMapState(database_.get());
  if (!state.ok() || !state->has_value()) return false;
  if ((*state)->log_token != log_token_) return !log_token_.empty() && (*state)->log_token == previous_log_token_;
  previous_log_token_ = "none";
  return true;
}

absl::Status SqliteMapStore::CloseWriting(bool ready) {
  const absl::Status in_place = CheckInPlace();
  // What follows from the map is not worth an error: readers do without.
  if (in_place.ok() && ready) RefreshReady().IgnoreError();
  // Deterministic runs leave the same file.
  if (in_place.ok() && !options_.record_wall_clock) writer_->EndLog().IgnoreError();
  writer_.reset();
  if (identity_.IsAt(resolved_) && !HasOwnContent()) {
    const absl::Status left = database_->CloseWithoutFolding();
    database_.reset();
    lock_.reset();
    return in_place.ok() ? left : in_place;
  }
  const absl::Status folded = database_->Execute("PRAGMA wal_checkpoint(TRUNCATE)");
  absl::Status status = folded;
  if (!in_place.ok()) status = Rescue(folded.ok() ? in_place : folded);
  const absl::Status closed = database_->Close();
  database_.reset();
  lock_.reset();
  return status.ok() ? closed : status;
}

absl::Status SqliteMapStore::CheckInPlace() {
  const std::string log = absl::StrCat(resolved_, kLogSuffix);
  const bool file_in_place = identity_.IsAt(resolved_);
  if (file_in_place && !HasOwnContent()) {
    return MakeFault(
        Fault::kMoved,
        absl::StrCat("another file was copied over it while it was written. That is left as it is; what was "
                     "mapped since it was opened is lost, but for what is in ",
                     log));
  }
  if (file_in_place && log_identity_.IsAt(log)) return absl::OkStatus();
  if (file_in_place) {
    return MakeFault(Fault::kMoved,
                     absl::StrCat("its write-ahead log ", log,
                                  " was removed or replaced while it was written; close the map, so that "
                                  "it is folded into the file, and open it again"));
  }
  const bool vacant = access(resolved_.c_str(), F_OK) != 0;
  const std::string what = vacant ? "it was removed or moved away while it was written"
                                  : "another file was put in its place while it was written";
  const auto now_at = identity_.CurrentPath();
  return MakeFault(Fault::kMoved,
                   now_at ? absl::StrCat(what, "; the map is in ", *now_at)
                          : absl::StrCat(what, "; what it holds is saved as ", RescuedPath(), " when it is closed"));
}

std::string SqliteMapStore::RescuedPath() const { return FreePath(absl::StrCat(resolved_, ".rescued")); }

absl::Status SqliteMapStore::Rescue(const absl::Status& moved) {
  // SQLite, too, sees that the file has moved, and leaves what lies beside its old name alone. What is there is this
  // map's own, and empty, if nothing else is.
  const std::string log = absl::StrCat(resolved_, kLogSuffix);
  if (identity_.IsAt(resolved_)) return absl::OkStatus();  // only the log was gone, and all of it is in the file now
  if (access(resolved_.c_str(), F_OK) != 0 && log_identity_.IsAt(log)) RemoveCompanions(resolved_);
  if (identity_.CurrentPath()) return moved;  // which says where the map is, complete by now
  const std::string rescued = RescuedPath();
  const absl::Status saved = CopyDatabase(database_.get(), rescued);
  if (!saved.ok()) {
    return Annotate(moved, absl::StrCat("the map is lost: saving it as ", rescued, " failed: ", saved.message()));
  }
  return MakeFault(Fault::kMoved,
                   absl::StrCat("it was removed or replaced while it was written; the map was saved as ", rescued));
}

absl::Status SqliteMapStore::Annotated(const absl::Status& status) const {
  return Annotate(status, absl::StrCat("map ", path_));
}

absl::Status SqliteMapStore::RequireWritable() const {
  if (writable()) return absl::OkStatus();
  return absl::FailedPreconditionError("it is open for reading only");
}

absl::Status SqliteMapStore::CheckUnchanged() const {
  if (immutable_stamp_.empty() || immutable_stamp_ == FileStamp(resolved_)) return absl::OkStatus();
  return MakeFault(Fault::kBusy, "it was written while it was read; open it again");
}

absl::Status SqliteMapStore::Commit(const map::Delta& delta) {
  CAIRN_RETURN_IF_ERROR(Annotated(RequireWritable()));
  CAIRN_RETURN_IF_ERROR(Annotated(CheckInPlace()));
  absl::Status written = Annotated(writer_->Commit(delta, options_.record_wall_clock ? NowUnixNs() : 0));
  if (FaultOf(written) == Fault::kFull && delta.base > 0) {  // not of a map that it would have made
    return MakeFault(Fault::kFull, absl::StrCat(written.message(), "; the map is at its last revision"));
  }
  return written;
}

absl::StatusOr<std::shared_ptr<const map::Snapshot>> SqliteMapStore::LoadSnapshot(const LoadOptions& options) {
  auto loaded = [&]() -> absl::StatusOr<std::shared_ptr<const map::Snapshot>> {
    std::shared_ptr<map::FeatureCache> cache;
    if (options.feature_budget_bytes) {
      CAIRN_ASSIGN_OR_RETURN(std::unique_ptr<map::FeatureReader> features,
                             OpenFeatureReader(path_, resolved_, identity_));
      cache = map::FeatureCache::Create(std::move(features), *options.feature_budget_bytes);
    }
    CAIRN_ASSIGN_OR_RETURN(const Transaction transaction,
                           Transaction::Begin(database_.get(), Transaction::Kind::kRead));
    MapReader reader(database_.get(), DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    CAIRN_RETURN_IF_ERROR(reader.ReadEntities({cache.get(), options.words}));
    CAIRN_ASSIGN_OR_RETURN(auto snapshot, reader.Assemble());
    CAIRN_RETURN_IF_ERROR(CheckUnchanged());
    return cache == nullptr ? snapshot : snapshot->With(std::move(cache));
  }();
  if (!loaded.ok()) return Annotated(loaded.status());
  return loaded;
}

absl::Status SqliteMapStore::PutVocabulary(absl::string_view bytes) {
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
    // Every change carries this row, by which a log is known.
    CAIRN_RETURN_IF_ERROR(writer_->PutMapRow(map_row));
    return transaction.Commit();
  };
  return Annotated(put());
}

absl::StatusOr<std::string> SqliteMapStore::LoadVocabulary() {
  auto loaded = [&]() -> absl::StatusOr<std::string> {
    std::optional<Transaction> transaction;  // both looks are at one revision
    if (!database_->InTransaction()) {
      CAIRN_ASSIGN_OR_RETURN(Transaction begun, Transaction::Begin(database_.get(), Transaction::Kind::kRead));
      transaction.emplace(std::move(begun));
    }
    CAIRN_ASSIGN_OR_RETURN(Statement rows,
                           database_->Prepare("SELECT bytes_checksum, length(bytes) FROM vocabulary WHERE id = 1"));
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
    if (!found) return absl::NotFoundError("it holds no vocabulary");
    const std::int64_t checksum = rows.Int(0);
    const auto size = static_cast<std::size_t>(rows.Int(1));
    rows.Reset();
    std::string bytes(size, '\0');
    CAIRN_ASSIGN_OR_RETURN(const bool read, database_->ReadBlob("vocabulary", "bytes", 1, bytes));
    if (!read || checksum != BlobChecksum(AsBytes(bytes))) {
      return DamagedBy({"vocabulary", 1, "bytes: wrong checksum"});
    }
    CAIRN_RETURN_IF_ERROR(CheckUnchanged());
    return bytes;
  }();
  if (!loaded.ok()) return Annotated(loaded.status());
  return loaded;
}

absl::Status SqliteMapStore::CheckStillThere() const {
  if (writable() || identity_.IsAt(resolved_)) return absl::OkStatus();
  return Annotated(MakeFault(Fault::kMoved, "it was removed, moved or replaced since it was opened; open it again"));
}

namespace {

// A file that is shorter than its header says; SQLite tells only once a page is asked for that is not there.
bool IsCutOff(Database* database, const std::string& path) {
  constexpr int kNumPagesAt = 28;  // https://sqlite.org/fileformat2.html#the_database_header
  const auto header = database->ReadHeader();
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  return !header.ok() || error ||
         size < std::uintmax_t{BigEndian32(header->data() + kNumPagesAt)} * PageBytesOf(*header);
}

}  // namespace

absl::Status SqliteMapStore::CheckNotWrittenOver() {
  const std::string stamp = FileStamp(resolved_);
  if (writable() || stamp == known_stamp_) return absl::OkStatus();
  // What is read here must be what somebody reads who opens it now; between the two looks a writer may commit.
  constexpr int kLooks = 5;
  for (int look = 0; look < kLooks; ++look) {
    std::string immutable_stamp;
    const auto anew = OpenForReading(resolved_, &immutable_stamp);
    const Fault fault = FaultOf(anew.status());
    if (fault == Fault::kBusy || fault == Fault::kIo || fault == Fault::kFull) return absl::OkStatus();  // next time
    const auto id = anew.ok() ? (*anew)->QueryText("SELECT map_id FROM map") : anew.status();
    if (!id.ok() || *id != map_id_ || IsCutOff(anew->get(), resolved_)) break;
    const auto there = (*anew)->QueryInt("SELECT revision FROM map");
    const auto here = database_->QueryInt("SELECT revision FROM map");
    if (!there.ok() || !here.ok()) break;
    if (*there != *here) continue;
    known_stamp_ = stamp;
    return absl::OkStatus();
  }
  return Annotated(MakeFault(Fault::kMoved, "another file was written over it since it was opened; open it again"));
}

absl::StatusOr<Revision> SqliteMapStore::ReadRevision() {
  CAIRN_RETURN_IF_ERROR(CheckStillThere());
  CAIRN_RETURN_IF_ERROR(CheckNotWrittenOver());
  const absl::StatusOr<std::int64_t> revision = database_->QueryInt("SELECT revision FROM map");
  if (!revision.ok()) return Annotated(revision.status());
  return static_cast<Revision>(*revision);
}

absl::StatusOr<std::optional<map::Delta>> SqliteMapStore::ReadDelta(const map::Snapshot& base) {
  CAIRN_RETURN_IF_ERROR(CheckStillThere());
  auto read = [&]() -> absl::StatusOr<std::optional<map::Delta>> {
    CAIRN_ASSIGN_OR_RETURN(const Transaction transaction,
                           Transaction::Begin(database_.get(), Transaction::Kind::kRead));
    CAIRN_ASSIGN_OR_RETURN(auto delta, DeltaReader(database_.get(), base).Read());
    CAIRN_RETURN_IF_ERROR(CheckUnchanged());
    return delta;
  }();
  if (!read.ok()) return Annotated(read.status());
  return read;
}

absl::StatusOr<std::optional<map::ChangedRows>> SqliteMapStore::ReadChangedRows(Revision since) {
  CAIRN_RETURN_IF_ERROR(CheckStillThere());
  auto read = [&]() -> absl::StatusOr<std::optional<map::ChangedRows>> {
    CAIRN_ASSIGN_OR_RETURN(const Transaction transaction,
                           Transaction::Begin(database_.get(), Transaction::Kind::kRead));
    MapReader reader(database_.get(), DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    CAIRN_RETURN_IF_ERROR(CheckRowCounts(database_.get(), reader.map_row().revision, Counted::kLog, DamagedBy));
    CAIRN_ASSIGN_OR_RETURN(auto rows, store::ReadChangedRows(database_.get(), since));
    CAIRN_RETURN_IF_ERROR(CheckUnchanged());
    return rows;
  }();
  if (!read.ok()) return Annotated(read.status());
  return read;
}

absl::StatusOr<MapSummary> SqliteMapStore::ReadSummary() {
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
    summary.format_version = static_cast<int>(reader.format());
    CAIRN_ASSIGN_OR_RETURN(summary.cameras, database_->QueryInt("SELECT count(*) FROM cameras"));
    CAIRN_ASSIGN_OR_RETURN(summary.sessions, database_->QueryInt("SELECT count(*) FROM sessions"));
    // Older formats have none by themselves; what they come to is found when the map is loaded.
    if (reader.format() >= 4) {
      CAIRN_ASSIGN_OR_RETURN(summary.components, database_->QueryInt("SELECT count(*) FROM components"));
    }
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

absl::StatusOr<std::vector<LoggedChange>> SqliteMapStore::ReadChanges(const ChangeQuery& query) {
  auto read = [&]() -> absl::StatusOr<std::vector<LoggedChange>> {
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t format, database_->QueryInt("PRAGMA user_version"));
    // Formats before 4 do not know who made a change.
    if (query.session && format < 4) return std::vector<LoggedChange>();
    const std::string by_session = query.session ? absl::StrCat(" AND session = ", query.session.value()) : "";
    CAIRN_ASSIGN_OR_RETURN(
        Statement rows,
        database_->Prepare(kChangesTable.SelectSql(
            absl::StrCat("WHERE revision >= ?1", by_session, " ORDER BY revision DESC LIMIT ?2"), format)));
    rows.Bind(1, static_cast<std::int64_t>(query.from_revision));
    rows.Bind(2, static_cast<std::int64_t>(std::max(0, query.max_count)));
    return ReadLog(std::move(rows));
  }();
  if (!read.ok()) return Annotated(read.status());
  return read;
}

absl::StatusOr<std::string> SqliteMapStore::ContentDigest() {
  auto digest = [&]() -> absl::StatusOr<std::string> {
    CAIRN_ASSIGN_OR_RETURN(const Transaction transaction,
                           Transaction::Begin(database_.get(), Transaction::Kind::kRead));
    MapReader reader(database_.get(), DamagedBy);
    CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
    if (CanGoByRows(reader.format(), reader.map_row())) {
      CAIRN_ASSIGN_OR_RETURN(std::string of_rows, DigestOfRows(database_.get()));
      CAIRN_RETURN_IF_ERROR(CheckUnchanged());
      return of_rows;
    }
    CAIRN_ASSIGN_OR_RETURN(auto features, FeatureReaderWithin(database_.get(), path_));
    const auto cache = map::FeatureCache::Create(std::move(features), /*budget_bytes=*/0);
    CAIRN_RETURN_IF_ERROR(reader.ReadEntities({cache.get()}));
    CAIRN_ASSIGN_OR_RETURN(const auto snapshot, reader.Assemble());
    std::string hash = store::ContentDigest(*snapshot);
    CAIRN_RETURN_IF_ERROR(cache->status());
    CAIRN_RETURN_IF_ERROR(CheckUnchanged());
    return hash;
  }();
  if (!digest.ok()) return Annotated(digest.status());
  return digest;
}

}  // namespace cairn::store
