// Localization against a map file in this process. The file is only read.
#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "api/localizer.h"
#include "client/map_reader.h"
#include "image/orb_extractor.h"
#include "image/undistort.h"
#include "map/snapshot.h"
#include "tracking/relocalizer.h"

namespace cairn::client {

struct LocalLocalizerOptions {
  tracking::RelocalizerOptions relocalizer;
  int num_features = 0;  // per query image; 0: as many as the map's keyframes were made with

  absl::Status Validate() const;
};

// Localize() may be called by several threads at once; Refresh() needs exclusive access.
class LocalLocalizer : public api::Localizer {
 public:
  // Loads the newest revision. Errors of the store (damaged, newer version, not a map, ...) come as they are;
  // FailedPrecondition if the map has no vocabulary.
  static absl::StatusOr<std::unique_ptr<LocalLocalizer>> Open(const std::string& path,
                                                              const LocalLocalizerOptions& options = {});

  // InvalidArgument: no 8-bit grey image, a camera that makes no sense, or one of another size than the image.
  absl::StatusOr<api::LocalizeAnswer> Localize(const api::LocalizeQuery& query) override;

  // Goes on to a newer revision if a writer has made one; true if so. Reads what has changed, as long as that is known
  // (store::kMaxDeltaRevisions).
  absl::StatusOr<bool> Refresh() { return map_->Refresh(); }

  const map::Snapshot& snapshot() const { return map_->view()->map(); }

 private:
  explicit LocalLocalizer(const LocalLocalizerOptions& options)
      : options_(options), relocalizer_(options.relocalizer) {}

  absl::StatusOr<api::LocalizeAnswer> Locate(const api::LocalizeQuery& query);
  std::shared_ptr<const image::Undistorter> KnownUndistorter(const Camera& camera);  // null: not known
  absl::StatusOr<std::shared_ptr<const image::Undistorter>> UndistorterFor(const Camera& camera);
  void FillPose(const tracking::Relocalization& found, api::LocalizeAnswer* answer) const;

  LocalLocalizerOptions options_;
  tracking::Relocalizer relocalizer_;
  std::unique_ptr<MapReader> map_;

  std::mutex mutex_;  // of the last cameras, most recent first: making undistortion maps takes longer than using them
  std::vector<std::shared_ptr<const image::Undistorter>> undistorters_;
};

}  // namespace cairn::client
