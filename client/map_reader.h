// A map file that is only read: one revision of it as a tracking::MapView, and the way on to what a writer adds to it.
// For one thread at a time; the views may be used by any number. Readers that share a file, each for a thread of its
// own, read every change once and hold every revision once.
#pragma once

#include <cstddef>
#include <memory>
#include <string>

#include "base/status.h"
#include "client/view_source.h"
#include "store/map_store.h"
#include "tracking/map_view.h"

namespace cairn::client {

struct MapReaderOptions {
  // Of features, that come from the file when a query needs them and are then kept (map/feature_cache.h).
  std::size_t feature_budget_bytes = 64'000'000;
  // Of keyframes and points of a map that is kept ready (docs/map-format.md), which come from the file likewise; looked
  // at when the map is refreshed.
  std::size_t entity_budget_bytes = 48'000'000;
};

class MapReader : public ViewSource {
 public:
  // Loads the newest revision. Errors of the store (damaged, newer version, not a map, ...) come as they are;
  // FailedPrecondition if the map has no vocabulary.
  static absl::StatusOr<std::unique_ptr<MapReader>> Open(const std::string& path, const MapReaderOptions& options = {});

  // The same from a revision on that is in memory: only what has changed since is read. If the file holds another map,
  // or has forgotten what followed, all of it.
  static absl::StatusOr<std::unique_ptr<MapReader>> OpenFrom(const std::string& path,
                                                             std::shared_ptr<const tracking::MapView> known);

  std::unique_ptr<ViewSource> Another() const override;

  const std::shared_ptr<const tracking::MapView>& view() const override { return view_; }

  // Goes on to a newer revision if a writer has made one; true if so. Reads what has changed, as long as that is known
  // (store::kMaxDeltaRevisions), and else all. After an error the view is what it was; after one of a look at features
  // (map::FeatureCache::status) the map is loaded anew.
  absl::StatusOr<bool> Refresh() override;

  absl::StatusOr<store::MapSummary> ReadSummary();

 private:
  class File;
  MapReader(std::shared_ptr<File> file, std::shared_ptr<const tracking::MapView> view)
      : file_(std::move(file)), view_(std::move(view)) {}

  std::shared_ptr<File> file_;
  std::shared_ptr<const tracking::MapView> view_;
};

}  // namespace cairn::client
