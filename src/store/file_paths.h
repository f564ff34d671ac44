// Where a map file is, by a name that nothing mistakes for something else, and whether SQLite may work there.
#pragma once

#include <optional>
#include <string>

#include "base/status.h"

namespace cairn::store {

// What may stand beside a map `path` (docs/map-format.md).
inline constexpr absl::string_view kLogSuffix = "-wal";           // the newest changes
inline constexpr absl::string_view kSharedMemorySuffix = "-shm";  // shared by those who have it open
inline constexpr absl::string_view kJournalSuffix = "-journal";   // while SQLite makes a new file
inline constexpr absl::string_view kLockSuffix = "-lock";         // of the writer
inline constexpr absl::string_view kNewSuffix = "-new";           // the map that will replace this one

// The absolute path with symbolic links resolved, as locks and SQLite's companion files go by the real name: a link is
// written through. Faults: kNotFound, kNotAMap (not a regular file, or empty), kIo; InvalidArgument if SQLite cannot
// take a path of that length.
enum class Empty { kRefused, kTaken };
absl::StatusOr<std::string> ResolveExisting(const std::string& path, Empty empty = Empty::kRefused);
// Likewise for a file that need not exist, but whose folder must.
absl::StatusOr<std::string> ResolveNew(const std::string& path);

// InvalidArgument for the name of what may stand beside a map: it would be taken for that, and removed.
absl::Status CheckNoCompanion(const std::string& path);

std::string FolderOf(const std::string& path);
bool HasContent(const std::string& path);
// `path`, or if there is something already, the first of `path`-2, `path`-3, ... where there is nothing.
std::string FreePath(const std::string& path);
// "doing: the reason", with the fault that the error of the operating system means.
absl::Status SystemFault(absl::string_view doing, int error);
absl::Status SyncFolder(const std::string& folder);
// What SQLite may leave beside a database.
void RemoveCompanions(const std::string& path);

// The name of the file system that holds `folder` if it is one of a network: SQLite's write-ahead log needs memory that
// all users of a file share, so all must be on one host.
std::optional<std::string> NetworkFileSystem(const std::string& folder);
// Whether a file system of that type is one; `type` as in /proc/self/mountinfo: "ext4", "nfs4", "fuse.sshfs".
bool IsNetworkType(absl::string_view type);

// Tells whether the file that was at a path is still there.
class FileIdentity {
 public:
  FileIdentity() = default;
  // Of what is at `path` now.
  static absl::StatusOr<FileIdentity> Of(const std::string& path);
  FileIdentity(FileIdentity&& other) noexcept;
  FileIdentity& operator=(FileIdentity&& other) noexcept;
  ~FileIdentity();

  bool IsAt(const std::string& path) const;
  // Where the file is now, as far as the operating system can tell; none if it has no name any more.
  std::optional<std::string> CurrentPath() const;

 private:
  // O_PATH: closing it does not drop SQLite's locks on the file.
  int descriptor_ = -1;
};

}  // namespace cairn::store
