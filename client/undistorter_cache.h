// Undistortion of the cameras that were seen last: making the tables of one takes longer than using them.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "base/status.h"
#include "geometry/camera.h"
#include "image/undistort.h"

namespace cairn::client {

// Any thread.
class UndistorterCache {
 public:
  absl::StatusOr<std::shared_ptr<const image::Undistorter>> For(const Camera& camera);

 private:
  std::shared_ptr<const image::Undistorter> Known(const Camera& camera);  // null: not known

  std::mutex mutex_;  // of the last cameras, most recent first
  std::vector<std::shared_ptr<const image::Undistorter>> undistorters_;
};

}  // namespace cairn::client
