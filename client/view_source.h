// Where a tracker or a localizer gets the revisions of its map from: a file, or a server that is followed.
#pragma once

#include <memory>

#include "base/status.h"
#include "tracking/map_view.h"

namespace cairn::client {

// How well the newest revision is known.
struct MapConnection {
  bool connected = true;  // to who changes the map
  double age_s = 0.0;     // since what is known of the map was the newest of it for certain; 0 for a file
};

// For one thread at a time, but for connection().
class ViewSource {
 public:
  virtual ~ViewSource() = default;

  virtual const std::shared_ptr<const tracking::MapView>& view() const = 0;

  // Goes on to the newest revision that is known; true if it is another one. After an error, which says what keeps the
  // map from being followed, the view is still good.
  virtual absl::StatusOr<bool> Refresh() = 0;

  // Another one that shares the map, at the revision of this one.
  virtual std::unique_ptr<ViewSource> Another() const = 0;

  // From any thread.
  virtual MapConnection connection() const { return {}; }
};

}  // namespace cairn::client
