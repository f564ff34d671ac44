// Summaries of many maps, each read again only once its file has changed: opening a map costs tens of milliseconds, and
// who lists a directory of a thousand does so often. Any thread.
#pragma once

#include <cstdint>
#include <map>
#include <mutex>
#include <string>

#include "base/status.h"
#include "store/map_store.h"

namespace cairn::store {

class SummaryCache {
 public:
  // As MapStore::ReadSummary() of the map at `uri`; errors as of OpenMapStore(), which are not kept.
  absl::StatusOr<MapSummary> Read(const std::string& uri);

 private:
  // Of a file and of its log, by which a change shows.
  struct Stamp {
    std::uint64_t device = 0, inode = 0;
    std::int64_t bytes = -1, changed_ns = 0;  // -1: there is no such file
    bool operator==(const Stamp&) const = default;
  };
  struct Entry {
    Stamp file, log;
    MapSummary summary;
  };
  static Stamp StampOf(const std::string& path);

  std::mutex mutex_;  // guards what follows; not held while a map is read
  std::map<std::string, Entry> entries_;
};

}  // namespace cairn::store
