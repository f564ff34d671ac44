#include "cli/map_camera.h"

#include <algorithm>
#include <set>

#include "absl/strings/str_format.h"
#include "absl/strings/str_join.h"
#include "map/camera_identity.h"

namespace cairn::cli {
namespace {

std::string SizeText(const Camera& camera) { return absl::StrCat(camera.width_px, "x", camera.height_px); }

// A camera, and the maps that have it.
struct SharedCamera {
  Camera camera;
  std::vector<std::string> maps;
};

std::vector<SharedCamera> DistinctCameras(const std::vector<CamerasOfMap>& maps, cv::Size size) {
  std::vector<SharedCamera> distinct;
  for (const CamerasOfMap& map : maps) {
    for (const Camera& camera : map.cameras) {
      if (camera.width_px != size.width || camera.height_px != size.height) continue;
      auto known = std::ranges::find_if(
          distinct, [&](const SharedCamera& other) { return map::SameCalibration(other.camera, camera); });
      if (known == distinct.end()) known = distinct.insert(known, {camera, {}});
      if (known->maps.empty() || known->maps.back() != map.map) known->maps.push_back(map.map);
    }
  }
  return distinct;
}

}  // namespace

std::vector<Camera> CamerasOf(const map::Snapshot& map) {
  std::vector<Camera> cameras;
  for (const auto& [id, camera] : map.cameras()) cameras.push_back(camera.model);
  return cameras;
}

absl::StatusOr<Camera> CameraOfSize(const std::vector<Camera>& cameras, cv::Size size, const std::string& photo) {
  const Camera* found = nullptr;
  std::set<std::string> sizes;
  for (const Camera& camera : cameras) {
    sizes.insert(SizeText(camera));
    if (camera.width_px != size.width || camera.height_px != size.height) continue;
    if (found != nullptr && !map::SameCalibration(*found, camera)) {
      return absl::InvalidArgumentError(absl::StrCat(photo, ": several cameras of the map take images of ", size.width,
                                                     "x", size.height, " pixels: say with --camera camera.yaml which"));
    }
    found = &camera;
  }
  if (found != nullptr) return *found;
  if (cameras.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(
        photo, " needs its calibration, as the map has no camera yet, nor any keyframes: give --camera camera.yaml"));
  }
  return absl::InvalidArgumentError(absl::StrCat(photo, " has ", size.width, "x", size.height,
                                                 " pixels, and the map's cameras take ", absl::StrJoin(sizes, ", "),
                                                 ": it needs its calibration, give --camera camera.yaml"));
}

absl::StatusOr<Camera> CameraOfMaps(const std::vector<CamerasOfMap>& maps, cv::Size size, const std::string& photo) {
  const std::vector<SharedCamera> distinct = DistinctCameras(maps, size);
  if (distinct.size() == 1) return distinct[0].camera;
  std::vector<std::string> texts;
  for (const SharedCamera& shared : distinct) {
    texts.push_back(absl::StrFormat("%s: %s with a focal length of %.2f px", absl::StrJoin(shared.maps, ", "),
                                    CameraModelName(shared.camera.model), shared.camera.fx_px));
  }
  if (!distinct.empty()) {
    return absl::InvalidArgumentError(absl::StrCat(photo, ": the maps have different cameras of ", size.width, "x",
                                                   size.height, " pixels (", absl::StrJoin(texts, "; "),
                                                   "): say with --camera camera.yaml which took it"));
  }
  for (const CamerasOfMap& map : maps) {
    std::set<std::string> sizes;
    for (const Camera& camera : map.cameras) sizes.insert(SizeText(camera));
    texts.push_back(absl::StrCat(map.map, ": ", sizes.empty() ? "no camera" : absl::StrJoin(sizes, ", ")));
  }
  return absl::InvalidArgumentError(absl::StrCat(photo, " has ", size.width, "x", size.height,
                                                 " pixels, and no camera of the maps takes such images (",
                                                 absl::StrJoin(texts, "; "), "): give --camera camera.yaml"));
}

}  // namespace cairn::cli
