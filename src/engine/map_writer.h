// The single writer of a map: applies each Delta to the map in memory, commits it to the file, and publishes the new
// Snapshot. The file appears with the first keyframe, so that a run that maps nothing leaves nothing behind (and an
// older map that was to be overwritten stays).
#pragma once

#include <condition_variable>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"
#include "store/map_store.h"

namespace cairn::engine {

class MapWriter {
 public:
  struct CreateOptions {
    bool overwrite = false;
    std::string vocabulary;         // serialised, stored with the map
    bool record_wall_clock = true;  // in the log of changes; off in deterministic runs
  };
  // A new map at `path`. AlreadyExists if there is a file and overwriting was not asked for; checked now, and when the
  // file is made.
  static absl::StatusOr<std::unique_ptr<MapWriter>> Create(const std::string& path, map::MapInfo info,
                                                           CreateOptions options);
  // An existing map, to be changed further.
  static absl::StatusOr<std::unique_ptr<MapWriter>> Open(const std::string& path);

  // Closes the store; a map that was to be overwritten is replaced now, in one step. Current() stays.
  absl::Status Close();

  // One call at a time. The map in memory, the file and the published snapshot change together or not at all; with
  // StoreInBackground() the file follows, by one change at most: the call waits for the one before, and returns its
  // error if it could not be stored. Nothing is stored after such an error.
  absl::StatusOr<std::shared_ptr<const map::Snapshot>> Commit(map::Delta delta);

  // From now on changes are written to the file by a thread, while the caller makes the next.
  void StoreInBackground();
  // Waits until all changes are in the file; the error if they are not.
  absl::Status Flush();

  // The newest revision; from any thread.
  std::shared_ptr<const map::Snapshot> Current() const;

  bool file_exists() const { return store_ && store_->writable() && has_keyframes_; }
  const std::string& path() const { return path_; }

  ~MapWriter();

 private:
  MapWriter() = default;
  void StoreChanges();

  std::string path_;
  std::unique_ptr<store::MapStore> store_;
  bool has_keyframes_ = false;  // so that there is a file
  mutable std::mutex mutex_;         // guards current_
  std::shared_ptr<const map::Snapshot> current_;

  // The thread that stores: `change_` is set while it has one to store.
  std::thread thread_;
  std::mutex store_mutex_;
  std::condition_variable store_changed_;
  std::optional<map::Delta> change_;
  absl::Status stored_;
  bool stop_ = false;
};

}  // namespace cairn::engine
