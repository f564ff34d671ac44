// Copies of a map file: SqliteMapStore::CopyTo, CopySound, Compact.
#include <unistd.h>

#include "absl/strings/str_cat.h"
#include "store/file_paths.h"
#include "store/map_open.h"
#include "store/sqlite.h"
#include "store/sqlite_map_store.h"
#include "store/verification.h"
#include "store/writer_lock.h"

namespace cairn::store {
namespace {

absl::Status VerifyCopy(Database* copy) {
  CAIRN_ASSIGN_OR_RETURN(const Transaction transaction, Transaction::Begin(copy, Transaction::Kind::kRead));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<Finding> findings, VerifyDatabase(copy, /*beside=*/nullptr));
  return StatusOf(findings);
}

// SQLite takes pages that are not in the file for a file that cannot grow.
absl::Status OrDamage(const absl::Status& copied, Database* database) {
  if (FaultOf(copied) != Fault::kFull) return copied;
  const absl::Status sound = VerifyCopy(database);
  return IsDamaged(sound) ? sound : copied;
}

}  // namespace

absl::Status SqliteMapStore::CopyTo(const std::string& path) { return Copy(path, {}); }

absl::Status SqliteMapStore::CopySound(const std::string& path) {
  if (!log_damage_.empty()) return Annotated(StatusOf({{"", 0, log_damage_}}));
  return Copy(path, VerifyCopy);
}

absl::Status SqliteMapStore::Copy(const std::string& path, const std::function<absl::Status(Database*)>& check) {
  const auto copy = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(const std::string resolved, ResolveNew(path));
    CAIRN_RETURN_IF_ERROR(CheckNoCompanion(resolved));
    CAIRN_RETURN_IF_ERROR(CheckFileSystem(resolved));
    CAIRN_ASSIGN_OR_RETURN(const auto lock, WriterLock::Acquire(resolved));
    if (access(resolved.c_str(), F_OK) == 0) {
      return MakeFault(Fault::kExists, absl::StrCat(path, " exists already: choose another name"));
    }
    CAIRN_RETURN_IF_ERROR(OrDamage(CopyDatabase(database_.get(), resolved, check), database_.get()));
    return CheckUnchanged();
  };
  return Annotate(Annotated(copy()), absl::StrCat("copying to ", path));
}

absl::Status SqliteMapStore::Compact() {
  CAIRN_RETURN_IF_ERROR(Annotated(RequireWritable()));
  CAIRN_RETURN_IF_ERROR(Annotated(OrDamage(database_->Execute("VACUUM"), database_.get())));
  return Annotated(database_->Execute("PRAGMA wal_checkpoint(TRUNCATE)"));
}

}  // namespace cairn::store
