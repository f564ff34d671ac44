#include "base/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <random>
#include <utility>

#include "base/guarded.h"

namespace cairn {
namespace {

absl::Status SystemError(absl::string_view what, const std::string& path) {
  const std::string message = absl::StrCat(what, " ", path, ": ", std::strerror(errno));
  switch (errno) {
    case ENOENT:
    case ENOTDIR:
      return absl::NotFoundError(message);
    case EACCES:
    case EPERM:
    case EROFS:
      return absl::PermissionDeniedError(message);
    case EEXIST:
      return absl::AlreadyExistsError(message);
    case ENOSPC:
    case EDQUOT:
      return absl::ResourceExhaustedError(message);
    case ENAMETOOLONG:
    case ELOOP:
      return absl::InvalidArgumentError(message);
    default:
      return absl::UnavailableError(message);
  }
}

absl::Status AlreadyThere(const std::string& path) {
  return absl::AlreadyExistsError(
      absl::StrCat(path, " exists already: choose another name, or allow overwriting (--overwrite)"));
}

std::string KindOf(mode_t mode) {
  if (S_ISREG(mode)) return "";
  if (S_ISDIR(mode)) return "is a folder";
  if (S_ISFIFO(mode)) return "is a pipe";
  if (S_ISSOCK(mode)) return "is a socket";
  return "is a device";
}

// Closed at the end of its life.
class Descriptor {
 public:
  explicit Descriptor(int fd) : fd_(fd) {}
  ~Descriptor() { Close(); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  int get() const { return fd_; }
  int Close() {
    const int fd = std::exchange(fd_, -1);
    return fd < 0 ? 0 : close(fd);
  }

 private:
  int fd_;
};

absl::StatusOr<std::string> ReadAll(const std::string& path, std::uint64_t max_bytes) {
  // A pipe without a writer would make opening wait for ever.
  const Descriptor file(open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY));
  if (file.get() < 0) return SystemError("reading", path);
  struct stat info = {};
  if (fstat(file.get(), &info) != 0) return SystemError("reading", path);
  if (const std::string kind = KindOf(info.st_mode); !kind.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(path, " ", kind, ", not a file",
                                                   S_ISFIFO(info.st_mode) ? ": write what it gives to one first" : ""));
  }
  const auto too_large = [&](std::uint64_t size) {
    return absl::InvalidArgumentError(
        absl::StrCat(path, " has ", size, " bytes or more; no file of its kind has more than ", max_bytes));
  };
  const auto size = static_cast<std::uint64_t>(info.st_size);
  if (size > max_bytes) return too_large(size);
  std::string contents;
  std::size_t filled = 0;
  for (;;) {  // the size is only a hint: /proc says 0, and files grow
    contents.resize(std::max<std::size_t>(filled + 4096, static_cast<std::size_t>(size) + 1));
    const ssize_t got = read(file.get(), contents.data() + filled, contents.size() - filled);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return SystemError("reading", path);
    filled += static_cast<std::size_t>(got);
    if (filled > max_bytes) return too_large(filled);
    if (got == 0) break;
  }
  contents.resize(filled);
  return contents;
}

absl::Status WriteAll(int file, absl::string_view contents, const std::string& path) {
  while (!contents.empty()) {
    const ssize_t written = write(file, contents.data(), contents.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return SystemError("writing", path);
    contents.remove_prefix(static_cast<std::size_t>(written));
  }
  if (fsync(file) != 0) return SystemError("syncing", path);
  return absl::OkStatus();
}

// What a chain of symbolic links ends at, whether it exists or not.
std::string FollowLinks(const std::string& path) {
  std::filesystem::path at = path;
  std::error_code error;
  for (int i = 0; i < 40 && std::filesystem::is_symlink(at, error); ++i) {
    const std::filesystem::path target = std::filesystem::read_symlink(at, error);
    if (error) break;
    at = target.is_absolute() ? target : at.parent_path() / target;
  }
  return at.string();
}

std::string FolderOf(const std::string& path) {
  const std::string folder = std::filesystem::path(path).parent_path().string();
  return folder.empty() ? "." : folder;
}

// A new file in the folder of `path`. Its name is short, as that of `path` may be as long as a name can be.
int CreateBeside(const std::string& path, mode_t mode, std::string* name) {
  std::random_device random;
  for (int attempt = 0; attempt < 100; ++attempt) {
    const std::string file = absl::StrCat(".cairn-", absl::Hex(random(), absl::kZeroPad8));
    *name = (std::filesystem::path(path).parent_path() / file).string();
    const int fd = open(name->c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, mode);
    if (fd >= 0 || errno != EEXIST) return fd;
  }
  return -1;
}

absl::Status MoveIntoPlace(const std::string& temporary, const std::string& path, bool overwrite) {
  if (!overwrite) {
    // Refuses atomically where the file system can; else the check at the start has to do.
    if (renameat2(AT_FDCWD, temporary.c_str(), AT_FDCWD, path.c_str(), RENAME_NOREPLACE) == 0) return absl::OkStatus();
    if (errno == EEXIST) return AlreadyThere(path);
    if (errno != EINVAL && errno != ENOSYS) return SystemError("writing", path);
  }
  if (std::rename(temporary.c_str(), path.c_str()) != 0) return SystemError("writing", path);
  return absl::OkStatus();
}

// What root writes for a service belongs to the service.
absl::Status KeepOwner(int file, const std::string& path) {
  struct stat owner = {};
  if (geteuid() != 0 || (stat(path.c_str(), &owner) != 0 && stat(FolderOf(path).c_str(), &owner) != 0)) {
    return absl::OkStatus();
  }
  return fchown(file, owner.st_uid, owner.st_gid) == 0 ? absl::OkStatus() : SystemError("giving to its owner", path);
}

absl::Status Write(const std::string& path, absl::string_view contents, bool overwrite, FilePermissions permissions) {
  if (const std::string kind = WhyNoFile(path); !kind.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(path, " ", kind, "; give a file name"));
  }
  std::error_code ignored;
  if (!overwrite && std::filesystem::exists(path, ignored)) return AlreadyThere(path);
  const std::string target = FollowLinks(path);
  std::string temporary;
  const bool owner_only = permissions == FilePermissions::kOwnerOnly;
  Descriptor file(CreateBeside(target, owner_only ? 0600 : 0666, &temporary));
  if (file.get() < 0) return SystemError("writing", path);
  absl::Status status = owner_only ? KeepOwner(file.get(), target) : absl::OkStatus();
  if (status.ok()) status = WriteAll(file.get(), contents, path);
  if (file.Close() != 0 && status.ok()) status = SystemError("writing", path);
  if (status.ok()) status = MoveIntoPlace(temporary, target, overwrite);
  if (!status.ok()) unlink(temporary.c_str());
  return status;
}

}  // namespace

std::string WhyNoFile(const std::string& path) {
  struct stat info = {};
  return stat(path.c_str(), &info) == 0 ? KindOf(info.st_mode) : "";
}

absl::StatusOr<std::string> ReadWholeFile(const std::string& path, std::uint64_t max_bytes) {
  return Guarded([&] { return ReadAll(path, max_bytes); });
}

absl::Status WriteFileAtomically(const std::string& path, absl::string_view contents, bool overwrite,
                                 FilePermissions permissions) {
  return Guarded([&] { return Write(path, contents, overwrite, permissions); });
}

}  // namespace cairn
