// Localizing without sending the image: its features are extracted here, as those of the map were, and sent.
#pragma once

#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "api/map_service.h"
#include "base/status.h"
#include "client/undistorter_cache.h"

namespace cairn::client {

// Any thread.
class FeatureSender {
 public:
  using Describe = std::function<absl::StatusOr<api::MapDescription>()>;
  using Send = std::function<absl::StatusOr<api::LocalizeAnswer>(const api::LocalizeQuery&)>;

  // The answer to `query`, which has an image. What the map asks for is found out once, by `describe`, and again if the
  // server then says that it is otherwise.
  absl::StatusOr<api::LocalizeAnswer> Localize(const std::string& map, const api::LocalizeQuery& query,
                                               const Describe& describe, const Send& send);

 private:
  struct Asked {
    image::OrbParameters orb;
    double finest_px = 0.0;  // focal length of the finest of the map's cameras
  };
  absl::StatusOr<Asked> AskedBy(const std::string& map, const Describe& describe);
  absl::StatusOr<api::LocalizeAnswer> SendFeatures(const Asked& asked, const api::LocalizeQuery& query,
                                                   const Send& send);

  UndistorterCache undistorters_;
  std::mutex mutex_;  // guards what follows
  std::map<std::string, Asked> asked_;
};

}  // namespace cairn::client
