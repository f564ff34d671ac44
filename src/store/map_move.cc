// A map file under another name.
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>

#include "store/file_paths.h"
#include "store/map_open.h"
#include "store/map_store.h"
#include "store/sqlite.h"
#include "store/write_ahead_log.h"
#include "store/writer_lock.h"

namespace cairn::store {
namespace {

// Puts what a killed writer left in the log into the file: the log goes by the file's name. kFull if there is no room.
absl::Status FoldLog(const std::string& path) {
  const std::string log = absl::StrCat(path, kLogSuffix);
  if (!HasContent(log)) return absl::OkStatus();
  CAIRN_RETURN_IF_ERROR(CheckLog(path, /*writing=*/true));
  CAIRN_ASSIGN_OR_RETURN(auto database, Database::OpenFile(path, Database::Mode::kReadWrite));
  CAIRN_RETURN_IF_ERROR(database->Execute("PRAGMA wal_checkpoint(TRUNCATE)"));
  CAIRN_RETURN_IF_ERROR(database->Close());
  if (!HasContent(log)) return absl::OkStatus();
  return MakeFault(Fault::kBusy, "somebody is reading it, so that its newest changes are not in the file: try again");
}

// On a full disk the log goes along, as moving takes no room. It has both names while the map changes its own, so that
// a process that is killed between loses nothing of it.
absl::Status MoveWithLog(const std::string& source, const std::string& target) {
  const auto log = [](const std::string& path) { return absl::StrCat(path, kLogSuffix); };
  if (link(log(source).c_str(), log(target).c_str()) != 0) {
    return SystemFault("giving its write-ahead log another name", errno);
  }
  if (rename(source.c_str(), target.c_str()) != 0) {
    const int error = errno;
    unlink(log(target).c_str());
    return SystemFault("giving it another name", error);
  }
  RemoveCompanions(source);
  return absl::OkStatus();
}

absl::Status MoveFile(const std::string& from, const std::string& to) {
  std::error_code error;
  if (std::filesystem::is_symlink(from, error)) {
    return absl::FailedPreconditionError("it is a link to another file: move that");
  }
  CAIRN_ASSIGN_OR_RETURN(const std::string source, ResolveExisting(from, Empty::kTaken));
  CAIRN_ASSIGN_OR_RETURN(const std::string target, ResolveNew(to));
  CAIRN_RETURN_IF_ERROR(CheckNoCompanion(target));
  CAIRN_RETURN_IF_ERROR(CheckFileSystem(source));
  CAIRN_RETURN_IF_ERROR(CheckOneName(source));
  CAIRN_ASSIGN_OR_RETURN(const auto source_lock, WriterLock::Acquire(source));
  CAIRN_ASSIGN_OR_RETURN(const auto target_lock, WriterLock::Acquire(target));
  if (access(target.c_str(), F_OK) == 0) return MakeFault(Fault::kExists, "there is a file of the new name already");
  const absl::Status folded = FoldLog(source);
  const bool with_log = FaultOf(folded) == Fault::kFull;
  if (!with_log) CAIRN_RETURN_IF_ERROR(folded);
  RemoveCompanions(target);
  if (with_log) {
    CAIRN_RETURN_IF_ERROR(MoveWithLog(source, target));
  } else {
    RemoveCompanions(source);
    if (rename(source.c_str(), target.c_str()) != 0) return SystemFault("giving it another name", errno);
  }
  CAIRN_RETURN_IF_ERROR(SyncFolder(FolderOf(target)));
  return SyncFolder(FolderOf(source));
}

}  // namespace

absl::Status MoveMapStore(const std::string& from_uri, const std::string& to_uri) {
  return Annotate(MoveFile(from_uri, to_uri), absl::StrCat("moving map ", from_uri));
}

}  // namespace cairn::store
