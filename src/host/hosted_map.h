// One map of a host that is in memory: its newest view. A writer in another process is followed.
#pragma once

#include <chrono>
#include <memory>
#include <mutex>
#include <string>

#include "base/status.h"
#include "client/map_reader.h"
#include "tracking/map_view.h"

namespace cairn::host {

class HostedMap {
 public:
  // Loads the newest revision; errors as MapReader::Open. `refresh_interval`: between looks for a newer one.
  static absl::StatusOr<std::shared_ptr<HostedMap>> Open(const std::string& uri,
                                                         std::chrono::milliseconds refresh_interval);

  // The newest revision. Waits for nobody: while one thread reads what has changed, others get the view before. The
  // fault kMoved if the map was removed or replaced: open it again. After any other error of the store the view stays
  // what it was, and the next call tries again.
  absl::StatusOr<std::shared_ptr<const tracking::MapView>> View();

  // The view that the last call of View() got, or the first one.
  std::shared_ptr<const tracking::MapView> Known() const;

  // In memory, roughly: by the size of what is in the store.
  std::int64_t bytes() const { return bytes_; }

 private:
  HostedMap(std::unique_ptr<client::MapReader> reader, std::int64_t stored_bytes,
            std::chrono::milliseconds refresh_interval);

  const std::int64_t bytes_;
  const std::chrono::milliseconds refresh_interval_;

  std::mutex reading_;  // held while the store is read; guards what follows
  std::unique_ptr<client::MapReader> reader_;
  std::chrono::steady_clock::time_point looked_;

  mutable std::mutex mutex_;  // guards what follows
  std::shared_ptr<const tracking::MapView> view_;
};

}  // namespace cairn::host
