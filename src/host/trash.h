// Deleted maps of a directory: files in its folder `.trash`, named `NAME.MILLISECONDS.cairn` by when they were deleted
// (since 1970), until they are restored or somebody removes them for good.
#pragma once

#include <string>
#include <vector>

#include "api/map_admin.h"
#include "base/status.h"

namespace cairn::host {

class Trash {
 public:
  explicit Trash(std::string directory) : directory_(std::move(directory)) {}

  // Moves `map`, whose file is at `path`, here. The name by which it is restored; errors as of store::MoveMapStore.
  absl::StatusOr<std::string> Take(const std::string& map, const std::string& path) const;
  // By time.
  absl::StatusOr<std::vector<api::DeletedMap>> List() const;
  // Moves it to `path`. NotFound (without a fault) if it is not here, kExists if there is something at `path`.
  absl::Status GiveBack(const std::string& deleted, const std::string& path) const;

 private:
  std::string PathOf(const std::string& deleted) const;
  const std::string directory_;  // of the maps
};

}  // namespace cairn::host
