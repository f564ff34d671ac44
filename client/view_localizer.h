// Localization against a view of a map, wherever that comes from: a file, or the head of a map that is being extended.
#pragma once

#include "api/localizer.h"
#include "client/undistorter_cache.h"
#include "tracking/map_error.h"
#include "tracking/map_view.h"
#include "tracking/relocalizer.h"

namespace cairn::client {

struct LocalLocalizerOptions {
  tracking::RelocalizerOptions relocalizer;
  tracking::MapErrorOptions map_error;
  int num_features = 0;  // per query image; 0: as many as the map's keyframes were made with

  absl::Status Validate() const;
};

// For any number of threads and maps at once.
class ViewLocalizer {
 public:
  explicit ViewLocalizer(const LocalLocalizerOptions& options) : options_(options), relocalizer_(options.relocalizer) {}

  // As api::Localizer::Localize(); FailedPrecondition if the map has no vocabulary.
  absl::StatusOr<api::LocalizeAnswer> Localize(const tracking::MapView& view, const api::LocalizeQuery& query);

 private:
  absl::StatusOr<api::LocalizeAnswer> Locate(const tracking::MapView& view, const api::LocalizeQuery& query);
  // What is done with an image, and with features. Times and the lens go to `answer`.
  absl::StatusOr<tracking::Relocalization> FindImage(const tracking::MapView& view, const api::LocalizeQuery& query,
                                                     const tracking::SearchArea& area, api::LocalizeAnswer* answer);
  absl::StatusOr<tracking::Relocalization> FindFeatures(const tracking::MapView& view, const api::LocalizeQuery& query,
                                                        const tracking::SearchArea& area, api::LocalizeAnswer* answer);

  const LocalLocalizerOptions options_;
  const tracking::Relocalizer relocalizer_;
  UndistorterCache undistorters_;
};

}  // namespace cairn::client
