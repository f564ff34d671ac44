// Localization in this process, against a map that is only read: a file, or one of a server that is followed
// (client/view_source.h).
#pragma once

#include <memory>
#include <string>

#include "api/localizer.h"
#include "client/view_localizer.h"
#include "client/view_source.h"
#include "map/snapshot.h"

namespace cairn::client {

// Localize() may be called by several threads at once; Refresh() needs exclusive access.
class LocalLocalizer : public api::Localizer {
 public:
  // Loads the newest revision. Errors of the store (damaged, newer version, not a map, ...) come as they are;
  // FailedPrecondition if the map has no vocabulary.
  static absl::StatusOr<std::unique_ptr<LocalLocalizer>> Open(const std::string& path,
                                                              const LocalLocalizerOptions& options = {});

  static absl::StatusOr<std::unique_ptr<LocalLocalizer>> Open(std::unique_ptr<ViewSource> map,
                                                              const LocalLocalizerOptions& options = {});

  // InvalidArgument: no 8-bit grey image, a camera that makes no sense, or one of another size than the image.
  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override {
    return localizer_.Localize(*map_->view(), query);
  }

  // Goes on to a newer revision if there is one; true if so. Costs what has changed.
  absl::StatusOr<bool> Refresh() { return map_->Refresh(); }

  // Of the same map at the same revision, sharing what is loaded; for another thread.
  std::unique_ptr<ViewSource> NewReader() const { return map_->Another(); }

  const map::Snapshot& snapshot() const { return map_->view()->map(); }

 private:
  explicit LocalLocalizer(const LocalLocalizerOptions& options) : localizer_(options) {}

  ViewLocalizer localizer_;
  std::unique_ptr<ViewSource> map_;
};

}  // namespace cairn::client
