#include "server/access/json_log.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <utility>

#include "absl/time/clock.h"
#include "absl/time/time.h"

namespace cairn::server {

absl::Status CheckIsLog(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  const int first = file.get();
  if (!file || first == '{' || first == '\n') return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat("the log ", path, " is a file with something else in it: name another one"));
}

absl::StatusOr<std::unique_ptr<JsonLog>> JsonLog::Open(const std::string& path, bool sync) {
  auto log = std::unique_ptr<JsonLog>(new JsonLog(path, sync));
  CAIRN_RETURN_IF_ERROR(log->Reopen());
  return log;
}

JsonLog::~JsonLog() {
  if (fd_ >= 0) close(fd_);
}

absl::Status JsonLog::Reopen() {
  if (fd_ >= 0) close(fd_);
  // A pipe without a reader would make it wait for ever.
  fd_ = open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0640);
  torn_ = false;
  if (fd_ >= 0) return CheckIsLog(path_);
  return absl::FailedPreconditionError(absl::StrCat("the log ", path_, " cannot be written: ", std::strerror(errno)));
}

absl::Status JsonLog::Append(absl::string_view line) {
  const std::lock_guard lock(mutex_);
  struct stat there = {}, held = {};
  const bool same = fd_ >= 0 && stat(path_.c_str(), &there) == 0 && fstat(fd_, &held) == 0 &&
                    there.st_ino == held.st_ino && there.st_dev == held.st_dev;
  if (!same) CAIRN_RETURN_IF_ERROR(Reopen());
  // In one piece, at the end, also if others write there; what was left of one before ends first.
  const std::string text = absl::StrCat(torn_ ? "\n" : "", line, "\n");
  const ssize_t written = write(fd_, text.data(), text.size());
  if (written > 0) torn_ = written != static_cast<ssize_t>(text.size());
  if (written != static_cast<ssize_t>(text.size()) || (sync_ && fdatasync(fd_) != 0 && errno != EINVAL)) {
    return absl::UnavailableError(absl::StrCat("writing the log ", path_, ": ", std::strerror(errno)));
  }
  return absl::OkStatus();
}

std::string LogTime() { return absl::FormatTime("%Y-%m-%dT%H:%M:%E3SZ", absl::Now(), absl::UTCTimeZone()); }

}  // namespace cairn::server
