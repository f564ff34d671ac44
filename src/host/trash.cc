#include "host/trash.h"

#include <algorithm>
#include <cerrno>
#include <filesystem>

#include "absl/strings/strip.h"
#include "engine/session_record.h"
#include "store/map_store.h"

namespace cairn::host {
namespace {

constexpr absl::string_view kTrashFolder = ".trash";
constexpr absl::string_view kMapSuffix = ".cairn";
constexpr std::int64_t kNsPerMs = 1'000'000;

}  // namespace

std::string Trash::PathOf(const std::string& deleted) const {
  return absl::StrCat(directory_, "/", kTrashFolder, "/", deleted, kMapSuffix);
}

absl::StatusOr<std::string> Trash::Take(const std::string& map, const std::string& path) const {
  std::error_code error;
  std::filesystem::create_directory(absl::StrCat(directory_, "/", kTrashFolder), error);
  if (error) {
    const bool full = error == std::errc::no_space_on_device || error.value() == EDQUOT;
    return store::MakeFault(full ? store::Fault::kFull : store::Fault::kReadOnly,
                            absl::StrCat("the trash cannot be made: ", error.message()));
  }
  // Two of one name may go in the same millisecond.
  for (std::int64_t ms = engine::UnixNowNs() / kNsPerMs;; ++ms) {
    const std::string deleted = absl::StrCat(map, ".", ms);
    const absl::Status moved = store::MoveMapStore(path, PathOf(deleted));
    if (store::FaultOf(moved) == store::Fault::kExists) continue;
    CAIRN_RETURN_IF_ERROR(moved);
    return deleted;
  }
}

absl::StatusOr<std::vector<api::DeletedMap>> Trash::List() const {
  std::vector<api::DeletedMap> maps;
  std::error_code error;
  std::filesystem::directory_iterator entries(absl::StrCat(directory_, "/", kTrashFolder), error);
  if (error) return maps;  // nothing was ever deleted
  for (const auto& entry : entries) {
    const std::string file = entry.path().filename().string();
    const std::string deleted(absl::StripSuffix(file, kMapSuffix));
    const absl::StatusOr<api::DeletedName> name = api::ParseDeletedName(deleted);
    if (deleted == file || !name.ok()) continue;
    const auto bytes = entry.file_size(error);
    maps.push_back({deleted, name->map, name->deleted_ms * kNsPerMs, error ? 0 : static_cast<std::int64_t>(bytes)});
  }
  std::ranges::sort(maps, [](const api::DeletedMap& x, const api::DeletedMap& y) {
    return std::pair(x.deleted_unix_ns, x.deleted) < std::pair(y.deleted_unix_ns, y.deleted);
  });
  return maps;
}

absl::Status Trash::GiveBack(const std::string& deleted, const std::string& path) const {
  CAIRN_RETURN_IF_ERROR(api::ParseDeletedName(deleted).status());
  std::error_code error;
  if (!std::filesystem::is_regular_file(std::filesystem::symlink_status(PathOf(deleted), error))) {
    return absl::NotFoundError(absl::StrCat("there is no \"", deleted, "\" in the trash"));
  }
  return store::MoveMapStore(PathOf(deleted), path);
}

}  // namespace cairn::host
