#include "store/summary_cache.h"

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <memory>

#include "store/file_paths.h"

namespace cairn::store {
namespace {

constexpr std::int64_t kNsPerSecond = 1'000'000'000;

// Two changes within one tick of the file system's clock have the same time: what was changed just now is not kept.
bool ChangedJustNow(std::int64_t changed_ns) {
  constexpr std::int64_t kTooClose_ns = kNsPerSecond;
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  const std::int64_t age_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(now).count() - changed_ns;
  return age_ns < kTooClose_ns;
}

}  // namespace

SummaryCache::Stamp SummaryCache::StampOf(const std::string& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return {};
  return {info.st_dev, info.st_ino, info.st_size, info.st_mtim.tv_sec * kNsPerSecond + info.st_mtim.tv_nsec};
}

absl::StatusOr<MapSummary> SummaryCache::Read(const std::string& uri) {
  const Stamp file = StampOf(uri), log = StampOf(absl::StrCat(uri, kLogSuffix));
  {
    const std::lock_guard lock(mutex_);
    const auto known = entries_.find(uri);
    if (known != entries_.end() && known->second.file == file && known->second.log == log) return known->second.summary;
    if (known != entries_.end()) entries_.erase(known);
  }
  CAIRN_ASSIGN_OR_RETURN(const std::unique_ptr<MapStore> map, OpenMapStore(uri, OpenMode::kRead));
  CAIRN_ASSIGN_OR_RETURN(MapSummary summary, map->ReadSummary());
  if (ChangedJustNow(std::max(file.changed_ns, log.changed_ns)) || log.bytes > 0) return summary;
  const std::lock_guard lock(mutex_);
  entries_[uri] = {file, log, summary};
  return summary;
}

}  // namespace cairn::store
