#include "cli/map_camera.h"

#include <set>

#include "absl/strings/str_join.h"
#include "map/camera_identity.h"

namespace cairn::cli {

std::vector<Camera> CamerasOf(const map::Snapshot& map) {
  std::vector<Camera> cameras;
  for (const auto& [id, camera] : map.cameras()) cameras.push_back(camera.model);
  return cameras;
}

absl::StatusOr<Camera> CameraOfSize(const std::vector<Camera>& cameras, cv::Size size, const std::string& photo) {
  const Camera* found = nullptr;
  std::set<std::string> sizes;
  for (const Camera& camera : cameras) {
    sizes.insert(absl::StrCat(camera.width_px, "x", camera.height_px));
    if (camera.width_px != size.width || camera.height_px != size.height) continue;
    if (found != nullptr && !map::SameCalibration(*found, camera)) {
      return absl::InvalidArgumentError(absl::StrCat(photo, ": several cameras of the map take images of ", size.width,
                                                     "x", size.height, " pixels: say with --camera camera.yaml which"));
    }
    found = &camera;
  }
  if (found != nullptr) return *found;
  return absl::InvalidArgumentError(absl::StrCat(
      photo, " has ", size.width, "x", size.height, " pixels, and the map's cameras take ",
      sizes.empty() ? "none" : absl::StrJoin(sizes, ", "), ": it needs its calibration, give --camera camera.yaml"));
}

}  // namespace cairn::cli
