// The right to write a map file: at most one holder among all processes, gone with the process that held it.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"

namespace cairn::store {

// An advisory lock (flock) on an empty file beside the map, `<map>-lock`. Not on the map itself: closing any descriptor
// of a database file drops the locks that SQLite holds on it in this process. A file left by a killed process means
// nothing; the next holder takes it over and removes it in the end.
class WriterLock {
 public:
  // Fault kBusy if another holder exists (in this process or another), kReadOnly if the folder cannot be written,
  // kNotFound if it does not exist.
  static absl::StatusOr<std::unique_ptr<WriterLock>> Acquire(const std::string& map_path);
  ~WriterLock();
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

 private:
  WriterLock(std::string path, int descriptor) : path_(std::move(path)), descriptor_(descriptor) {}
  std::string path_;
  int descriptor_;
};

}  // namespace cairn::store
