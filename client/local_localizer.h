// Localization against a map file in this process. The file is only read.
#pragma once

#include <memory>
#include <string>

#include "api/localizer.h"
#include "client/map_reader.h"
#include "client/view_localizer.h"
#include "map/snapshot.h"

namespace cairn::client {

// Localize() may be called by several threads at once; Refresh() needs exclusive access.
class LocalLocalizer : public api::Localizer {
 public:
  // Loads the newest revision. Errors of the store (damaged, newer version, not a map, ...) come as they are;
  // FailedPrecondition if the map has no vocabulary.
  static absl::StatusOr<std::unique_ptr<LocalLocalizer>> Open(const std::string& path,
                                                              const LocalLocalizerOptions& options = {});

  // InvalidArgument: no 8-bit grey image, a camera that makes no sense, or one of another size than the image.
  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override {
    return localizer_.Localize(*map_->view(), query);
  }

  // Goes on to a newer revision if a writer has made one; true if so. Reads what has changed, as long as that is known
  // (store::kMaxDeltaRevisions).
  absl::StatusOr<bool> Refresh() { return map_->Refresh(); }

  // Of the same file at the same revision, sharing what is loaded; for another thread.
  std::unique_ptr<MapReader> NewReader() const { return map_->Another(); }

  const map::Snapshot& snapshot() const { return map_->view()->map(); }

 private:
  explicit LocalLocalizer(const LocalLocalizerOptions& options) : localizer_(options) {}

  ViewLocalizer localizer_;
  std::unique_ptr<MapReader> map_;
};

}  // namespace cairn::client
