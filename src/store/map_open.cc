#include "store/map_open.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <map>
#include <utility>

#include "store/delta_writer.h"
#include "store/fault.h"
#include "store/migrations.h"

namespace cairn::store {
namespace {

std::string FolderOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

absl::Status SystemFault(absl::string_view doing, int error) {
  const std::string message = absl::StrCat(doing, ": ", std::strerror(error));
  if (error == ENOSPC || error == EDQUOT || error == EFBIG) return MakeFault(Fault::kFull, message);
  if (error == EACCES || error == EPERM || error == EROFS) return MakeFault(Fault::kReadOnly, message);
  return MakeFault(Fault::kIo, message);
}

bool HasContent(const std::string& path) {
  struct stat info {};
  return stat(path.c_str(), &info) == 0 && info.st_size > 0;
}

absl::Status SyncFolder(const std::string& folder) {
  const int descriptor = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) return SystemFault("opening the folder", errno);
  const int failed = fsync(descriptor) != 0 ? errno : 0;
  close(descriptor);
  // Some file systems do not sync folders; there is nothing more to be done on those.
  return failed == 0 || failed == EINVAL ? absl::OkStatus() : SystemFault("syncing the folder", failed);
}

// What SQLite may leave beside a database.
void RemoveCompanions(const std::string& path) {
  for (const char* suffix : {"-wal", "-shm", "-journal"}) unlink((path + suffix).c_str());
}

}  // namespace

absl::StatusOr<std::string> ResolveExisting(const std::string& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) {
    if (errno == ENOENT || errno == ENOTDIR) return MakeFault(Fault::kNotFound, "there is no such file");
    return MakeFault(Fault::kIo, std::strerror(errno));
  }
  if (S_ISDIR(info.st_mode)) return MakeFault(Fault::kNotAMap, "it is a folder, not a Cairn map");
  if (!S_ISREG(info.st_mode)) return MakeFault(Fault::kNotAMap, "it is not a regular file, and so not a Cairn map");
  if (info.st_size == 0) return MakeFault(Fault::kNotAMap, "it is empty, not a Cairn map");
  if (access(path.c_str(), R_OK) != 0)
    return MakeFault(Fault::kIo, absl::StrCat("cannot be read: ", std::strerror(errno)));
  std::error_code error;
  const std::filesystem::path resolved = std::filesystem::canonical(path, error);
  if (error) return MakeFault(Fault::kIo, error.message());
  return resolved.string();
}

absl::StatusOr<std::string> ResolveNew(const std::string& path) {
  if (path.empty() || path.back() == '/') {
    return absl::InvalidArgumentError(absl::StrCat("'", path, "' is not the name of a file"));
  }
  struct stat info {};
  if (stat(path.c_str(), &info) == 0 && S_ISDIR(info.st_mode)) {
    return MakeFault(Fault::kNotAMap, "it is a folder; give the name of a file");
  }
  std::error_code error;
  const std::filesystem::path resolved = std::filesystem::weakly_canonical(path, error);
  if (error) return MakeFault(Fault::kIo, error.message());
  if (!std::filesystem::is_directory(resolved.parent_path().empty() ? "." : resolved.parent_path(), error)) {
    return MakeFault(Fault::kNotFound, absl::StrCat("there is no folder ", FolderOf(path)));
  }
  return resolved.string();
}

absl::Status CheckIdentity(Database* database) {
  constexpr absl::string_view kMagic("SQLite format 3\0", 16);
  constexpr std::size_t kApplicationIdAt = 68;
  CAIRN_ASSIGN_OR_RETURN(const auto header, database->ReadHeader());
  const bool is_sqlite = std::memcmp(header.data(), kMagic.data(), kMagic.size()) == 0;
  std::int64_t application_id = 0;
  for (std::size_t i = 0; i < 4; ++i) application_id = application_id * 256 + header[kApplicationIdAt + i];
  if (!is_sqlite) {
    if (application_id == kApplicationId)
      return MakeFault(Fault::kDamaged, "the file is damaged: its first bytes are wrong");
    return MakeFault(Fault::kNotAMap, "it is not a Cairn map (nor any SQLite database)");
  }
  if (application_id != kApplicationId) {
    return MakeFault(Fault::kNotAMap, "it is an SQLite database, but not a Cairn map");
  }
  CAIRN_ASSIGN_OR_RETURN(const std::int64_t version, database->QueryInt("PRAGMA user_version"));
  if (version < 1)
    return MakeFault(Fault::kDamaged, absl::StrCat("the file is damaged: its format version is ", version));
  if (version > SupportedFormatVersion()) {
    return MakeFault(Fault::kNewerVersion, absl::StrCat("it was written by a newer Cairn: map format ", version,
                                                        ", and this software knows formats up to ",
                                                        SupportedFormatVersion(), "; update Cairn"));
  }
  return absl::OkStatus();
}

absl::Status CheckSchema(Database* database, bool views, const FindingSink& sink) {
  const std::string sql = absl::StrCat("SELECT name, sql FROM sqlite_schema WHERE sql IS NOT NULL AND type IN (",
                                       views ? "'view'" : "'table', 'index'", ") ORDER BY name");
  using Objects = std::map<std::string, std::string>;
  const auto read = [&sql](Database* from) -> absl::StatusOr<Objects> {
    Objects objects;
    CAIRN_ASSIGN_OR_RETURN(Statement rows, from->Prepare(sql));
    while (true) {
      CAIRN_ASSIGN_OR_RETURN(const bool found, rows.Step());
      if (!found) return objects;
      objects.emplace(rows.Text(0), rows.Text(1));
    }
  };
  CAIRN_ASSIGN_OR_RETURN(const auto pristine, Database::OpenFile("", Database::Mode::kMemory));
  // Of the format that the file has: older ones are read as they are.
  CAIRN_ASSIGN_OR_RETURN(const std::int64_t version, database->QueryInt("PRAGMA user_version"));
  const auto migrations = BuiltInMigrations();
  const auto applied =
      std::min<std::size_t>(static_cast<std::size_t>(std::max<std::int64_t>(0, version)), migrations.size());
  CAIRN_RETURN_IF_ERROR(Migrate(pristine.get(), migrations.first(applied)));
  CAIRN_ASSIGN_OR_RETURN(const Objects expected, read(pristine.get()));
  CAIRN_ASSIGN_OR_RETURN(const Objects actual, read(database));
  for (const auto& [name, text] : expected) {
    const auto found = actual.find(name);
    if (found != actual.end() && found->second == text) continue;
    CAIRN_RETURN_IF_ERROR(
        sink(Finding{name, 0, found == actual.end() ? "is missing" : "is not defined as it should be"}));
  }
  return absl::OkStatus();
}

std::string FileStamp(const std::string& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return "gone";
  return absl::StrCat(info.st_dev, " ", info.st_ino, " ", info.st_size, " ", info.st_mtim.tv_sec, " ",
                      info.st_mtim.tv_nsec, HasContent(path + "-wal") ? " written" : "");
}

absl::StatusOr<std::unique_ptr<Database>> OpenForReading(const std::string& path, std::string* immutable_stamp) {
  // With write permission SQLite can remove its companion files in the end; it is held to change nothing otherwise.
  const bool can_write = access(path.c_str(), W_OK) == 0 && access(FolderOf(path).c_str(), W_OK) == 0;
  CAIRN_ASSIGN_OR_RETURN(auto database,
                         Database::OpenFile(path, can_write ? Database::Mode::kQueryOnly : Database::Mode::kReadOnly));
  absl::Status status = CheckIdentity(database.get());
  const Fault fault = FaultOf(status);
  if (fault != Fault::kReadOnly && fault != Fault::kIo) {
    if (!status.ok()) return status;
    return database;
  }
  // On a read-only medium SQLite cannot make the companion files that it shares with writers.
  if (HasContent(path + "-wal")) {
    return MakeFault(Fault::kReadOnly, absl::StrCat("its newest changes are in ", path,
                                                    "-wal still and cannot be read in a folder "
                                                    "that cannot be written; copy both files to one that can (",
                                                    status.message(), ")"));
  }
  *immutable_stamp = FileStamp(path);
  CAIRN_ASSIGN_OR_RETURN(database, Database::OpenFile(path, Database::Mode::kImmutable));
  CAIRN_RETURN_IF_ERROR(CheckIdentity(database.get()));
  return database;
}

absl::Status PrepareForWriting(Database* database, const WriteOptions& options) {
  CAIRN_ASSIGN_OR_RETURN(const std::string mode, database->QueryText("PRAGMA journal_mode = WAL"));
  if (mode != "wal") {
    return MakeFault(Fault::kIo, absl::StrCat("SQLite cannot keep a write-ahead log here (journal mode is ", mode,
                                              "); is the folder on a network file system?"));
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

absl::Status WriteNewMap(const std::string& path, const map::MapInfo& info, absl::string_view vocabulary) {
  // Only one process comes here for a path: the caller holds the writer's lock.
  const std::string fresh = path + "-new";
  unlink(fresh.c_str());
  RemoveCompanions(fresh);
  const absl::Status written = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(auto database, Database::OpenFile(fresh, Database::Mode::kCreate));
    CAIRN_RETURN_IF_ERROR(database->Execute("PRAGMA synchronous = FULL"));
    CAIRN_RETURN_IF_ERROR(Migrate(database.get(), BuiltInMigrations()));
    {
      CAIRN_ASSIGN_OR_RETURN(auto writer, DeltaWriter::Prepare(database.get()));
      CAIRN_ASSIGN_OR_RETURN(Transaction transaction, Transaction::Begin(database.get(), Transaction::Kind::kWrite));
      MapRow row;
      row.info = info;
      CAIRN_RETURN_IF_ERROR(writer->PutMapRow(row));
      if (!vocabulary.empty()) CAIRN_RETURN_IF_ERROR(WriteVocabulary(database.get(), vocabulary));
      CAIRN_RETURN_IF_ERROR(transaction.Commit());
    }
    CAIRN_RETURN_IF_ERROR(PrepareForWriting(database.get(), {}));
    CAIRN_RETURN_IF_ERROR(database->Close());
    // A log of the file that is replaced would be taken for one of the new file.
    RemoveCompanions(path);
    if (rename(fresh.c_str(), path.c_str()) != 0) return SystemFault("putting the new map in place", errno);
    // A reader that came to the old file in between may have made new ones.
    RemoveCompanions(path);
    return SyncFolder(FolderOf(path));
  }();
  if (!written.ok()) {
    unlink(fresh.c_str());
    RemoveCompanions(fresh);
  }
  return written;
}

}  // namespace cairn::store
