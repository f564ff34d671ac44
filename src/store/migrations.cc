#include "store/migrations.h"

#include <string>

#include "store/fault.h"

namespace cairn::store {

absl::Status Migrate(Database* database, std::span<const Migration> migrations,
                     const std::function<absl::Status()>& fill) {
  const std::int64_t newest = migrations.empty() ? 0 : migrations.back().version;
  CAIRN_ASSIGN_OR_RETURN(std::int64_t version, database->QueryInt("PRAGMA user_version"));
  if (version == newest) return absl::OkStatus();
  // Tables may be rebuilt on the way; references are checked at the end. Has no effect inside a transaction.
  CAIRN_RETURN_IF_ERROR(database->Execute("PRAGMA foreign_keys = OFF"));
  const absl::Status status = [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(Transaction transaction, Transaction::Begin(database, Transaction::Kind::kWrite));
    // Another process may have been faster.
    CAIRN_ASSIGN_OR_RETURN(version, database->QueryInt("PRAGMA user_version"));
    if (version > newest) {
      return MakeFault(Fault::kNewerVersion,
                       absl::StrCat("it was written by a newer Cairn: map format ", version,
                                    ", and this software knows formats up to ", newest, "; update Cairn"));
    }
    for (const Migration& migration : migrations) {
      if (migration.version <= version) continue;
      const std::string context =
          absl::StrCat("bringing the map to format ", migration.version, " (", migration.name, ")");
      CAIRN_RETURN_IF_ERROR(Annotate(database->Execute(std::string(migration.sql)), context));
    }
    if (fill) CAIRN_RETURN_IF_ERROR(fill());
    CAIRN_ASSIGN_OR_RETURN(Statement check, database->Prepare("PRAGMA foreign_key_check"));
    CAIRN_ASSIGN_OR_RETURN(const bool broken, check.Step());
    if (broken) {
      return MakeFault(Fault::kDamaged,
                       absl::StrCat("table ", check.Text(0), " row ", check.Int(1), " refers to a missing row"));
    }
    check = Statement();
    CAIRN_RETURN_IF_ERROR(database->Execute(
        absl::StrCat("PRAGMA application_id = ", kApplicationId, "; PRAGMA user_version = ", newest)));
    return transaction.Commit();
  }();
  CAIRN_RETURN_IF_ERROR(database->Execute("PRAGMA foreign_keys = ON"));
  return status;
}

}  // namespace cairn::store
