#include "store/map_open.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <map>
#include <utility>

#include "store/delta_writer.h"
#include "store/fault.h"
#include "store/file_paths.h"
#include "store/log_damage.h"
#include "store/migrations.h"
#include "store/ready_pages.h"
#include "store/row.h"
#include "store/sqlite_record.h"
#include "store/write_ahead_log.h"
#include "store/writer_lock.h"

namespace cairn::store {
namespace {

using Objects = std::map<std::string, std::string>;  // SQL by name

absl::StatusOr<Objects> ReadObjects(Database* database, bool views) {
  Objects objects;
  CAIRN_ASSIGN_OR_RETURN(Statement rows, database->Prepare(absl::StrCat(
                                             "SELECT name, sql FROM sqlite_schema WHERE sql IS NOT NULL AND type IN (",
                                             views ? "'view'" : "'table', 'index'", ") ORDER BY name")));
  while (true) {
    CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
    if (!found) return objects;
    objects.emplace(rows.Text(0), rows.Text(1));
  }
}

// What the migrations up to a format make.
absl::StatusOr<Objects> ObjectsOfFormat(std::int64_t format, bool views) {
  CAIRN_ASSIGN_OR_RETURN(const auto pristine, Database::OpenFile("", Database::Mode::kMemory));
  const auto migrations = BuiltInMigrations();
  const auto known = static_cast<std::int64_t>(migrations.size());
  const auto applied = static_cast<std::size_t>(std::clamp<std::int64_t>(format, 0, known));
  CAIRN_RETURN_IF_ERROR(Migrate(pristine.get(), migrations.first(applied)));
  return ReadObjects(pristine.get(), views);
}

// The format whose tables and indexes the file has, whatever its header says; 0: of none.
std::int64_t FormatOfTables(Database* database) {
  const absl::StatusOr<Objects> actual = ReadObjects(database, /*views=*/false);
  if (!actual.ok()) return 0;
  for (std::int64_t format = SupportedFormatVersion(); format > 0; --format) {
    const absl::StatusOr<Objects> expected = ObjectsOfFormat(format, /*views=*/false);
    if (expected.ok() && std::ranges::includes(*actual, *expected)) return format;
  }
  return 0;
}

absl::Status WrongHeader(std::int64_t format, absl::string_view what) {
  return MakeFault(Fault::kDamaged, absl::StrCat("the file is damaged: its tables are those of a Cairn map of format ",
                                                 format, ", but its header ", what));
}

}  // namespace

absl::Status CheckIdentity(Database* database) {
  constexpr absl::string_view kMagic("SQLite format 3\0", 16);
  CAIRN_ASSIGN_OR_RETURN(const auto header, database->ReadHeader());
  const bool is_sqlite = std::memcmp(header.data(), kMagic.data(), kMagic.size()) == 0;
  const std::int64_t application_id = BigEndian32(header.data() + kApplicationIdAt);
  if (!is_sqlite) {
    if (application_id == kApplicationId)
      return MakeFault(Fault::kDamaged, "the file is damaged: its first bytes are wrong");
    return MakeFault(Fault::kNotAMap, "it is not a Cairn map (nor any SQLite database)");
  }
  if (application_id != kApplicationId) {
    if (const std::int64_t format = FormatOfTables(database)) return WrongHeader(format, "names another program");
    return MakeFault(Fault::kNotAMap, "it is an SQLite database, but not a Cairn map");
  }
  CAIRN_ASSIGN_OR_RETURN(const std::int64_t version, database->QueryInt("PRAGMA user_version"));
  if (version >= 1 && version <= SupportedFormatVersion()) return absl::OkStatus();
  if (const std::int64_t format = FormatOfTables(database)) {
    return WrongHeader(format, absl::StrCat("says format ", version));
  }
  if (version < 1)
    return MakeFault(Fault::kDamaged, absl::StrCat("the file is damaged: its format version is ", version));
  return MakeFault(Fault::kNewerVersion, absl::StrCat("it was written by a newer Cairn: map format ", version,
                                                      ", and this software knows formats up to ",
                                                      SupportedFormatVersion(), "; update Cairn"));
}

namespace {

// BlobChecksum() of what the migrations make, tables and indexes: what nearly every map has, and is known by at once.
// Making them to compare takes longer than all else that opening a map does. store_test tells when it has changed.
constexpr std::int64_t kNewestObjects = 2831155148169634942;

std::int64_t ChecksumOf(const Objects& objects) {
  std::string text;
  for (const auto& [name, sql] : objects) {
    if (name != kReadyTable) absl::StrAppend(&text, name.size(), " ", name, sql.size(), " ", sql);
  }
  return BlobChecksum(AsBytes(text));
}

}  // namespace

absl::StatusOr<bool> HasNewestObjects(Database* database) {
  CAIRN_ASSIGN_OR_RETURN(const Objects actual, ReadObjects(database, /*views=*/false));
  return ChecksumOf(actual) == kNewestObjects;
}

absl::Status CheckSchema(Database* database, bool views, const FindingSink& sink) {
  // Of the format that the file has: older ones are read as they are.
  CAIRN_ASSIGN_OR_RETURN(const std::int64_t version, database->QueryInt("PRAGMA user_version"));
  CAIRN_ASSIGN_OR_RETURN(const Objects actual, ReadObjects(database, views));
  if (!views && version == SupportedFormatVersion() && ChecksumOf(actual) == kNewestObjects) {
    return absl::OkStatus();
  }
  CAIRN_ASSIGN_OR_RETURN(const Objects expected, ObjectsOfFormat(version, views));
  for (const auto& [name, text] : expected) {
    const auto found = actual.find(name);
    if (found != actual.end() && found->second == text) continue;
    CAIRN_RETURN_IF_ERROR(
        sink(Finding{name, 0, found == actual.end() ? "is missing" : "is not defined as it should be"}));
  }
  if (version >= SupportedFormatVersion()) return absl::OkStatus();
  // A header that says too low a format would leave out, without a word, what later ones added.
  CAIRN_ASSIGN_OR_RETURN(const Objects newest, ObjectsOfFormat(SupportedFormatVersion(), views));
  for (const auto& [name, text] : newest) {
    if (expected.contains(name) || !actual.contains(name)) continue;
    CAIRN_RETURN_IF_ERROR(sink(Finding{
        name, 0, absl::StrCat("is of a later format than ", version, ", which the file's header says it has")}));
  }
  return absl::OkStatus();
}

std::string LeftoverNote(const std::string& path, bool writing) {
  const std::string fresh = absl::StrCat(path, kNewSuffix);
  if (!HasContent(fresh) || (!writing && WriterLock::IsHeld(path))) return "";
  return absl::StrCat(fresh,
                      " is a map that was to replace this one when its writer was killed: it is whole up to its last "
                      "change. Move it to another name to use it, or delete it");
}

std::string FileStamp(const std::string& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return "gone";
  return absl::StrCat(info.st_dev, " ", info.st_ino, " ", info.st_size, " ", info.st_mtim.tv_sec, " ",
                      info.st_mtim.tv_nsec, HasContent(path + "-wal") ? " written" : "");
}

namespace {

// As if nothing could change the file: SQLite needs nothing beside it.
absl::StatusOr<std::unique_ptr<Database>> OpenImmutable(const std::string& path, const absl::Status& why,
                                                        std::string* immutable_stamp) {
  if (HasContent(path + "-wal")) {
    return MakeFault(FaultOf(why), absl::StrCat("its newest changes are in ", path,
                                                "-wal still and cannot be read here: copy both files to a folder that "
                                                "can be written and has room (",
                                                why.message(), ")"));
  }
  if (WriterLock::IsHeld(path)) return why;
  *immutable_stamp = FileStamp(path);
  CAIRN_ASSIGN_OR_RETURN(auto database, Database::OpenFile(path, Database::Mode::kImmutable));
  CAIRN_RETURN_IF_ERROR(CheckIdentity(database.get()));
  return database;
}

}  // namespace

absl::StatusOr<std::unique_ptr<Database>> OpenForReading(const std::string& path, std::string* immutable_stamp) {
  CAIRN_RETURN_IF_ERROR(CheckLog(path));
  if (const auto network = NetworkFileSystem(FolderOf(path))) {
    return OpenImmutable(path, MakeFault(Fault::kIo, absl::StrCat("it is on a file system of type ", *network)),
                         immutable_stamp);
  }
  // With write permission SQLite can remove its companion files in the end; it is held to change nothing otherwise.
  const bool can_write = access(path.c_str(), W_OK) == 0 && access(FolderOf(path).c_str(), W_OK) == 0;
  const bool had_log = access((path + "-wal").c_str(), F_OK) == 0;
  const bool log_damaged = had_log && !LogDamageOf(path).empty();
  auto database = Database::OpenFile(path, can_write ? Database::Mode::kQueryOnly : Database::Mode::kReadOnly);
  absl::Status status = database.status();
  // Else what lies behind the damage would be gone with the log.
  if (status.ok() && log_damaged) (*database)->LeaveLog();
  if (status.ok()) status = CheckIdentity(database->get());
  // On a read-only medium, or a full one, SQLite cannot make the companion files that it shares with writers.
  const Fault fault = FaultOf(status);
  if (fault != Fault::kReadOnly && fault != Fault::kIo && fault != Fault::kFull) {
    if (!status.ok()) return status;
    return database;
  }
  if (database.ok()) database->reset();
  // What it began to make has no content.
  if (!had_log && !HasContent(path + "-wal") && !WriterLock::IsHeld(path)) RemoveCompanions(path);
  return OpenImmutable(path, status, immutable_stamp);
}

absl::Status PrepareForWriting(Database* database, const WriteOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::string mode, database->QueryText("PRAGMA journal_mode = WAL"));
  if (mode != "wal") {
    return MakeFault(Fault::kIo,
                     absl::StrCat("SQLite cannot keep a write-ahead log here (journal mode is ", mode, ")"));
  }
  return database->Execute(absl::StrCat("PRAGMA synchronous = ", options.sync_every_commit ? "FULL" : "NORMAL",
                                        "; PRAGMA journal_size_limit = 33554432"));
}

absl::Status WriteVocabulary(Database* database, absl::string_view bytes) {
  CAIRN_ASSIGN_OR_RETURN(Statement put, database->Prepare(kVocabularyTable.UpsertSql()));
  put.Bind(1, std::int64_t{1});
  put.Bind(2, BlobChecksum(AsBytes(bytes)));
  put.Bind(3, AsBytes(bytes));
  return put.Run();
}

absl::Status CheckNewInfo(const map::MapInfo& info) {
  const bool is_id = info.id.size() == 32 && std::all_of(info.id.begin(), info.id.end(), [](char c) {
                       return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
                     });
  if (!is_id) return absl::InvalidArgumentError(absl::StrCat("the map id '", info.id, "' is not 32 hex digits"));
  // So that the row of table `map` stays within a page (write_ahead_log.h).
  constexpr std::size_t kMaxTextBytes = 1000;
  if (info.name.size() > kMaxTextBytes || info.software_version.size() > kMaxTextBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("the name of the map or its software has more than ", kMaxTextBytes, " bytes"));
  }
  return info.orb.Validate();
}

absl::Status CheckFileSystem(const std::string& path) {
  const auto network = NetworkFileSystem(FolderOf(path));
  if (!network) return absl::OkStatus();
  return MakeFault(Fault::kIo,
                   absl::StrCat("its folder is on a network file system (", *network,
                                "), where maps cannot be written: the write-ahead log needs all users of a map on one "
                                "host. Write it on a local disk and copy it there when it is closed"));
}

absl::Status CheckOneName(const std::string& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0 || info.st_nlink == 1) return absl::OkStatus();
  return absl::FailedPreconditionError(absl::StrCat("the file has ", info.st_nlink,
                                                    " names (hard links), and would change under all of them without "
                                                    "their knowing of each other's locks; make a copy and write that"));
}

absl::Status CopyDatabase(Database* database, const std::string& path,
                          const std::function<absl::Status(Database*)>& check) {
  // Into a new name and then in place, so that the copy appears as a whole.
  const std::string fresh = absl::StrCat(path, kNewSuffix);
  unlink(fresh.c_str());
  RemoveCompanions(fresh);
  const absl::Status copied = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t was_query_only, database->QueryInt("PRAGMA query_only"));
    CAIRN_RETURN_IF_ERROR(database->Execute("PRAGMA query_only = OFF"));
    const absl::Status vacuumed = [&]() -> absl::Status {
      CAIRN_ASSIGN_OR_RETURN(Statement copy, database->Prepare("VACUUM INTO ?"));
      copy.Bind(1, absl::string_view(fresh));
      return copy.Run();
    }();
    CAIRN_RETURN_IF_ERROR(database->Execute(absl::StrCat("PRAGMA query_only = ", was_query_only)));
    CAIRN_RETURN_IF_ERROR(vacuumed);
    CAIRN_ASSIGN_OR_RETURN(auto target, Database::OpenFile(fresh, Database::Mode::kReadWrite));
    CAIRN_ASSIGN_OR_RETURN(const std::int64_t format, target->QueryInt("PRAGMA user_version"));
    if (format >= 4) {
      CAIRN_ASSIGN_OR_RETURN(const auto writer, DeltaWriter::Prepare(target.get()));
      CAIRN_RETURN_IF_ERROR(writer->BeginLog());
    }
    if (check) CAIRN_RETURN_IF_ERROR(check(target.get()));
    CAIRN_RETURN_IF_ERROR(PrepareForWriting(target.get(), {}));
    CAIRN_RETURN_IF_ERROR(target->Close());
    return PutInPlace(fresh, path);
  }();
  if (!copied.ok()) {
    unlink(fresh.c_str());
    RemoveCompanions(fresh);
  }
  return copied;
}

absl::Status WriteMapAt(const std::string& fresh, const MapRow& row, absl::string_view vocabulary) {
  // Only one process comes here for a path: the caller holds the writer's lock.
  unlink(fresh.c_str());
  RemoveCompanions(fresh);
  const absl::Status written = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(auto database, Database::OpenFile(fresh, Database::Mode::kCreate));
    CAIRN_RETURN_IF_ERROR(database->Execute("PRAGMA synchronous = FULL"));
    CAIRN_RETURN_IF_ERROR(Migrate(database.get(), BuiltInMigrations()));
    {
      CAIRN_ASSIGN_OR_RETURN(auto writer, DeltaWriter::Prepare(database.get()));
      CAIRN_ASSIGN_OR_RETURN(Transaction transaction, Transaction::Begin(database.get(), Transaction::Kind::kWrite));
      CAIRN_RETURN_IF_ERROR(writer->PutMapRow(row));
      if (!vocabulary.empty()) CAIRN_RETURN_IF_ERROR(WriteVocabulary(database.get(), vocabulary));
      CAIRN_RETURN_IF_ERROR(transaction.Commit());
    }
    CAIRN_RETURN_IF_ERROR(PrepareForWriting(database.get(), {}));
    return database->Close();
  }();
  if (!written.ok()) {
    unlink(fresh.c_str());
    RemoveCompanions(fresh);
  }
  return written;
}

absl::Status WriteNewMap(const std::string& path, const map::MapInfo& info, absl::string_view vocabulary) {
  const std::string fresh = absl::StrCat(path, kNewSuffix);
  MapRow row;
  row.info = info;
  CAIRN_RETURN_IF_ERROR(WriteMapAt(fresh, row, vocabulary));
  const absl::Status placed = PutInPlace(fresh, path);
  if (!placed.ok()) unlink(fresh.c_str());
  return placed;
}

absl::Status PutInPlace(const std::string& fresh, const std::string& path) {
  // A log that a killed writer left is of the file that is replaced: it stays whole until that goes.
  if (HasContent(absl::StrCat(path, kLogSuffix)) && CheckLog(path).ok()) {
    CAIRN_ASSIGN_OR_RETURN(auto old, Database::OpenFile(path, Database::Mode::kReadWrite));
    old->Execute("PRAGMA wal_checkpoint(TRUNCATE)").IgnoreError();
  }
  RemoveCompanions(path);
  if (rename(fresh.c_str(), path.c_str()) != 0) return SystemFault("putting the new map in place", errno);
  // A reader that came to the old file in between may have made new ones.
  RemoveCompanions(path);
  return SyncFolder(FolderOf(path));
}

}  // namespace cairn::store
