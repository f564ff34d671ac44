#include "store/map_store.h"

#include "store/sqlite_map_creation.h"
#include "store/sqlite_map_store.h"

namespace cairn::store {
namespace {

// "postgresql://host/map" is no path. A path with a scheme's colon alone is one: "file:x", "C:map".
absl::Status CheckIsPath(const std::string& uri) {
  const std::size_t separator = uri.find("://");
  if (separator == std::string::npos || separator == 0 || uri.find('/') < separator) return absl::OkStatus();
  return absl::InvalidArgumentError(
      absl::StrCat("map ", uri, ": this software keeps maps in files; ", uri.substr(0, separator), "://... is none"));
}

}  // namespace

absl::StatusOr<std::unique_ptr<MapStore>> OpenMapStore(const std::string& uri, OpenMode mode,
                                                       const WriteOptions& options) {
  CAIRN_RETURN_IF_ERROR(CheckIsPath(uri));
  if (mode == OpenMode::kRead) return SqliteMapStore::OpenReadOnly(uri);
  return SqliteMapStore::Open(uri, options);
}

absl::StatusOr<std::unique_ptr<MapStore>> CreateMapStore(const std::string& uri, const map::MapInfo& info,
                                                         CreateOptions options) {
  CAIRN_RETURN_IF_ERROR(CheckIsPath(uri));
  if (options.at_once) return SqliteMapStore::Create(uri, info, options);
  return NewSqliteMap::Create(uri, info, std::move(options));
}

}  // namespace cairn::store
