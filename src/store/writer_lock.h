// The right to write a map file: at most one holder among all processes, gone with the process that held it.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"

namespace cairn::store {

// An advisory lock (flock) on a small file beside the map, `<map>-lock`, which holds the process id of the holder, for
// people. Not on the map itself: closing any descriptor of a database file drops the locks that SQLite holds on it in
// this process. A file left by a killed process means nothing; the next holder takes it over and removes it in the end.
class WriterLock {
 public:
  // Fault kBusy, naming the process, if another holder exists (in this process or another), kReadOnly if the folder
  // cannot be written, kNotFound if it does not exist.
  static absl::StatusOr<std::unique_ptr<WriterLock>> Acquire(const std::string& map_path);
  // Whether somebody holds it; false where that cannot be found out.
  static bool IsHeld(const std::string& map_path);

  // Removes the file, if it is still the one that was locked: somebody who took that away has made room for the lock of
  // another process.
  ~WriterLock();
  WriterLock(const WriterLock&) = delete;
  WriterLock& operator=(const WriterLock&) = delete;

 private:
  WriterLock(std::string path, int descriptor) : path_(std::move(path)), descriptor_(descriptor) {}
  std::string path_;
  int descriptor_;
};

}  // namespace cairn::store
