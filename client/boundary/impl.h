// What is behind the classes of the public headers; tests put a tracker of their own there.
#pragma once

#include <memory>
#include <mutex>
#include <utility>

#include "api/tracker.h"
#include "cairn/map.h"
#include "client/boundary/map_state.h"
#include "geometry/camera.h"

namespace cairn::v0 {

class Map::Impl {
 public:
  explicit Impl(std::shared_ptr<client::MapState> map) : map_(std::move(map)) {}
  client::MapState& map() { return *map_; }
  const std::shared_ptr<client::MapState>& shared_map() const { return map_; }

 private:
  std::shared_ptr<client::MapState> map_;
};

class Localizer::Impl {
 public:
  explicit Impl(std::shared_ptr<client::MapState> map) : map_(std::move(map)) {}
  client::MapState& map() { return *map_; }

 private:
  std::shared_ptr<client::MapState> map_;
};

class Tracker::Impl {
 public:
  // `camera` has been validated.
  Impl(cairn::Camera camera, std::unique_ptr<api::Tracker> tracker)
      : camera_(std::move(camera)), tracker_(std::move(tracker)) {}
  absl::StatusOr<TrackAnswer> Track(const ImageView& image, std::int64_t time_ns, const CallOptions& call);

 private:
  const cairn::Camera camera_;
  std::mutex mutex_;  // one call at a time
  const std::unique_ptr<api::Tracker> tracker_;
};

}  // namespace cairn::v0
