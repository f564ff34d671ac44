// A file of one JSON object per line that only grows: what was changed by whom (audit), what was asked (requests).
#pragma once

#include <memory>
#include <mutex>
#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::server {

class JsonLog {
 public:
  // Appends to the file, or makes it, readable by owner and group. `sync`: a line is on the disk when Append() returns.
  // FailedPrecondition if it cannot be written, or has something else in it than lines of JSON.
  static absl::StatusOr<std::unique_ptr<JsonLog>> Open(const std::string& path, bool sync);
  ~JsonLog();
  JsonLog(const JsonLog&) = delete;
  JsonLog& operator=(const JsonLog&) = delete;

  // One line, without its end. Any thread. A file that was moved away or removed (logrotate) is made anew.
  absl::Status Append(absl::string_view line);

 private:
  JsonLog(std::string path, bool sync) : path_(std::move(path)), sync_(sync) {}
  absl::Status Reopen();

  const std::string path_;
  const bool sync_;
  std::mutex mutex_;  // guards what follows
  int fd_ = -1;
  bool torn_ = false;  // the last line is there in part, as the disk was full
};

// FailedPrecondition if there is a file with something else in it than lines of JSON, which must not be appended to.
absl::Status CheckIsLog(const std::string& path);

// Now, UTC, as "2026-11-26T12:00:00.123Z".
std::string LogTime();

}  // namespace cairn::server
