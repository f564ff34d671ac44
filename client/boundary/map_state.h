// What the copies of a cairn::Map and its localizers share: the map at the revision that it has been brought to.
#pragma once

#include <functional>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <string>

#include "api/localizer.h"
#include "base/status.h"
#include "client/local_localizer.h"
#include "client/remote/server_access.h"
#include "client/view_source.h"
#include "map/snapshot.h"

namespace cairn::client {

// Thread-safe.
class MapState {
 public:
  // `path`: a file, or "cairn://HOST:PORT/NAME", a map of a server. Errors as of LocalLocalizer::Open() and
  // RemoteMapService::CopyOf().
  static absl::StatusOr<std::shared_ptr<MapState>> Open(const std::string& path, const LocalLocalizerOptions& options,
                                                        const ServerAccess& server = {});

  // Waits for the readers that there are, and those that come later for it.
  absl::StatusOr<bool> Refresh();

  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query);
  // `read` gets the revision that the map is at, and must not keep it.
  void Read(const std::function<void(const map::Snapshot&)>& read);

  // For a tracker: it shares what is loaded and begins at the revision that the map is at.
  std::unique_ptr<ViewSource> NewReader();

 private:
  explicit MapState(std::unique_ptr<LocalLocalizer> localizer) : localizer_(std::move(localizer)) {}
  std::shared_lock<std::shared_mutex> LockToRead();

  const std::unique_ptr<LocalLocalizer> localizer_;
  // Taken by everybody for a moment before mutex_: a stream of readers would otherwise keep Refresh() out for good.
  std::mutex gate_;
  std::shared_mutex mutex_;  // exclusive while localizer_ goes on to another revision
};

}  // namespace cairn::client
