// A map file that is only read: its newest revision as a tracking::MapView, and the way on to what a writer adds to it.
// For one thread at a time; the views may be used by any number.
#pragma once

#include <memory>
#include <string>

#include "base/status.h"
#include "place/vocabulary.h"
#include "store/map_store.h"
#include "tracking/map_view.h"

namespace cairn::client {

class MapReader {
 public:
  // Loads the newest revision. Errors of the store (damaged, newer version, not a map, ...) come as they are;
  // FailedPrecondition if the map has no vocabulary.
  static absl::StatusOr<std::unique_ptr<MapReader>> Open(const std::string& path);

  const std::shared_ptr<const tracking::MapView>& view() const { return view_; }

  // Goes on to a newer revision if a writer has made one; true if so. Reads what has changed, as long as that is known
  // (store::kMaxDeltaRevisions), and else all. After an error the view is what it was.
  absl::StatusOr<bool> Refresh();

  absl::StatusOr<store::MapSummary> ReadSummary() { return file_->ReadSummary(); }

 private:
  MapReader() = default;
  absl::Status Load();

  std::unique_ptr<store::MapStore> file_;
  std::shared_ptr<const place::Vocabulary> vocabulary_;
  std::shared_ptr<const tracking::MapView> view_;
};

}  // namespace cairn::client
