// One map of a host that is in memory: its newest view, whoever writes it. While sessions of this process extend it,
// that is what engine::LiveMap has published; else it is read from the store, and a writer in another process is
// followed.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "base/status.h"
#include "client/map_reader.h"
#include "engine/live_map.h"
#include "tracking/map_view.h"

namespace cairn::host {

class HostedMap : public std::enable_shared_from_this<HostedMap> {
 public:
  // While it is true maps are closed without what only makes them open faster: the process is to end soon.
  using Hurry = std::shared_ptr<const std::atomic<bool>>;

  // Loads the newest revision; errors as MapReader::Open. `refresh_interval`: between looks for a newer one. `hurry`
  // may be null: there never is one.
  static absl::StatusOr<std::shared_ptr<HostedMap>> Open(const std::string& uri,
                                                         std::chrono::milliseconds refresh_interval,
                                                         Hurry hurry = nullptr);
  // A map that is made by `live`; it can be read once its first keyframe is durable. The owners of `*shared` are its
  // sessions.
  static std::shared_ptr<HostedMap> Over(const std::string& uri, std::unique_ptr<engine::LiveMap> live,
                                         std::chrono::milliseconds refresh_interval,
                                         std::shared_ptr<engine::LiveMap>* shared, Hurry hurry = nullptr);

  // The newest revision. Waits for nobody but who loads the map: while one thread reads what has changed, others get
  // the view before. The fault kMoved if the map was removed or replaced: open it again. After any other error of the
  // store the view stays what it was, and the next call tries again. The fault kNotFound while there is no keyframe.
  absl::StatusOr<std::shared_ptr<const tracking::MapView>> View();
  // What is known of it without looking: while it is written here the newest view, else the last one that View() got.
  // Null: none yet.
  std::shared_ptr<const tracking::MapView> Known() const;

  // A reader of the map, for a tracker: what is in memory already is not read again, whoever writes the map.
  absl::StatusOr<std::unique_ptr<client::ViewSource>> NewReader();

  // The head of the map, for sessions: one for all of them, closed when the last one lets go of it.
  absl::StatusOr<std::shared_ptr<engine::LiveMap>> Write();
  bool writing() const;
  // Returns when there may be a newer revision than View() gave before the call before, and no later than `until`.
  // `news` is the caller's, from one call to the next; at first null.
  void WaitForChange(std::chrono::steady_clock::time_point until, std::shared_ptr<engine::Subscription>* news) const;

 private:
  HostedMap(std::string uri, std::chrono::milliseconds refresh_interval, Hurry hurry)
      : uri_(std::move(uri)), refresh_interval_(refresh_interval), hurry_(std::move(hurry)) {}
  // Closed when the last session lets go of it; what it had published is kept.
  std::shared_ptr<engine::LiveMap> Adopt(std::unique_ptr<engine::LiveMap> live);
  absl::StatusOr<std::unique_ptr<client::MapReader>> OpenReader() const;
  absl::StatusOr<std::shared_ptr<const tracking::MapView>> Keep(std::shared_ptr<const tracking::MapView> view);
  std::shared_ptr<engine::LiveMap> Live() const;

  const std::string uri_;
  const std::chrono::milliseconds refresh_interval_;
  const Hurry hurry_;

  std::mutex reading_;                         // held while the store is opened or read; guards what follows
  std::unique_ptr<client::MapReader> reader_;  // null while it is written here, and until it is read again
  std::chrono::steady_clock::time_point looked_;

  mutable std::mutex mutex_;  // guards what follows
  std::shared_ptr<const tracking::MapView> view_;
  std::weak_ptr<engine::LiveMap> live_;
};

}  // namespace cairn::host
