#include "io/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <vector>

namespace cairn::io {
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
    default:
      return absl::UnavailableError(message);
  }
}

absl::Status AlreadyThere(const std::string& path) {
  return absl::AlreadyExistsError(absl::StrCat(path, " exists; allow overwriting or choose another name"));
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

// A new file beside `path`, with the permissions that any new file gets (mkstemp's has none for others, and to ask for
// the process's mask means to change it under all other threads). -1 and errno on failure.
int OpenTemporary(const std::string& path, std::string* temporary) {
  std::random_device random;
  for (int attempt = 0; attempt < 100; ++attempt) {
    *temporary = absl::StrCat(path, ".", absl::Hex(random(), absl::kZeroPad8));
    const int file = open(temporary->c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file >= 0 || errno != EEXIST) return file;
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

}  // namespace

absl::Status WriteFileAtomically(const std::string& path, absl::string_view contents, bool overwrite) {
  std::error_code ignored;
  if (std::filesystem::is_directory(path, ignored)) {
    return absl::InvalidArgumentError(absl::StrCat(path, " is a folder; give a file name"));
  }
  if (!overwrite && std::filesystem::exists(path, ignored)) return AlreadyThere(path);
  std::string temporary;
  const int file = OpenTemporary(path, &temporary);
  if (file < 0) return SystemError("writing", path);
  absl::Status status = WriteAll(file, contents, path);
  if (close(file) != 0 && status.ok()) status = SystemError("writing", path);
  if (status.ok()) status = MoveIntoPlace(temporary, path, overwrite);
  if (!status.ok()) unlink(temporary.c_str());
  return status;
}

absl::StatusOr<std::string> ReadWholeFile(const std::string& path) {
  std::error_code error;
  if (std::filesystem::is_directory(path, error)) {
    return absl::InvalidArgumentError(absl::StrCat(path, " is a folder, not a file"));
  }
  constexpr std::uintmax_t kMaxBytes = 1u << 30;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (!error && size > kMaxBytes) {
    return absl::InvalidArgumentError(absl::StrCat(path, " has ", size, " bytes, more than any file of its kind"));
  }
  errno = 0;
  std::ifstream in(path, std::ios::binary);
  if (!in) return SystemError("reading", path);
  std::ostringstream contents;
  contents << in.rdbuf();
  if (in.bad()) return SystemError("reading", path);
  return std::move(contents).str();
}

}  // namespace cairn::io
