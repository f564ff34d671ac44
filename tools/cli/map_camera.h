// Photos that a map's own camera took need no calibration file.
#pragma once

#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "base/status.h"
#include "geometry/camera.h"
#include "map/snapshot.h"

namespace cairn::cli {

// As calibrated, of the raw images.
std::vector<Camera> CamerasOf(const map::Snapshot& map);

// The one camera of a map that takes images of this size. InvalidArgument if there is none, or several that differ:
// names `photo`, the sizes and --camera.
absl::StatusOr<Camera> CameraOfSize(const std::vector<Camera>& cameras, cv::Size size, const std::string& photo);

struct CamerasOfMap {
  std::string map;
  std::vector<Camera> cameras;
};
// The same of several maps, which must agree; those without a camera of this size have no say. InvalidArgument also
// says which of them have which.
absl::StatusOr<Camera> CameraOfMaps(const std::vector<CamerasOfMap>& maps, cv::Size size, const std::string& photo);

}  // namespace cairn::cli
