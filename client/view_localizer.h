// Localization against a view of a map, wherever that comes from: a file, or the head of a map that is being extended.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "api/localizer.h"
#include "image/undistort.h"
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
  std::shared_ptr<const image::Undistorter> KnownUndistorter(const Camera& camera);  // null: not known
  absl::StatusOr<std::shared_ptr<const image::Undistorter>> UndistorterFor(const Camera& camera);

  const LocalLocalizerOptions options_;
  const tracking::Relocalizer relocalizer_;

  std::mutex mutex_;  // of the last cameras, most recent first: making undistortion maps takes longer than using them
  std::vector<std::shared_ptr<const image::Undistorter>> undistorters_;
};

}  // namespace cairn::client
