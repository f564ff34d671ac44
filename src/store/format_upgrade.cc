#include "store/format_upgrade.h"

#include <memory>
#include <utility>

#include "store/delta_writer.h"
#include "store/file_paths.h"
#include "store/map_open.h"
#include "store/map_reader.h"
#include "store/migrations.h"
#include "store/tables.h"

namespace cairn::store {
namespace {

absl::StatusOr<std::string> MakeBackup(Database* database, const std::string& path, std::int64_t format) {
  const std::string backup = FreePath(absl::StrCat(path, ".format", format, "-backup"));
  CAIRN_RETURN_IF_ERROR(Annotate(CopyDatabase(database, backup), absl::StrCat("making the backup ", backup)));
  return backup;
}

}  // namespace

absl::Status UpgradeFormat(Database* database, const std::string& path, std::vector<std::string>* notes) {
  CAIRN_ASSIGN_OR_RETURN(const std::int64_t format, database->QueryInt("PRAGMA user_version"));
  if (format >= SupportedFormatVersion()) return absl::OkStatus();
  CAIRN_RETURN_IF_ERROR(CheckSchema(database, /*views=*/false, DamagedBy));
  MapReader reader(database, DamagedBy);
  CAIRN_RETURN_IF_ERROR(reader.ReadInfo());
  CAIRN_RETURN_IF_ERROR(reader.ReadEntities());
  CAIRN_ASSIGN_OR_RETURN(Statement log, database->Prepare(kChangesTable.SelectSql("ORDER BY revision", format)));
  CAIRN_ASSIGN_OR_RETURN(const std::vector<LoggedChange> changes, ReadLog(std::move(log)));
  CAIRN_ASSIGN_OR_RETURN(const std::shared_ptr<const map::Snapshot> map, reader.Assemble());
  CAIRN_ASSIGN_OR_RETURN(const std::string backup, MakeBackup(database, path, format));
  CAIRN_RETURN_IF_ERROR(Migrate(database, BuiltInMigrations(), [&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(const auto writer, DeltaWriter::Prepare(database));
    return writer->PutUpgraded(*map, changes, reader.map_row());
  }));
  notes->push_back(absl::StrCat("the map was brought from format ", format, " to ", SupportedFormatVersion(),
                                "; as it was before, it is in ", backup));
  return absl::OkStatus();
}

}  // namespace cairn::store
