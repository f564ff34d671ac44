#include "client/query_image.h"

#include "map/camera_identity.h"
#include "map/lens.h"

namespace cairn::client {

absl::Status CheckImage(const cv::Mat& image, const Camera& camera, const char* who) {
  if (image.empty() || image.type() != CV_8UC1) {
    return absl::InvalidArgumentError(absl::StrCat(who, ": the image must be 8-bit grey (CV_8UC1) and not empty"));
  }
  if (image.cols != camera.width_px || image.rows != camera.height_px) {
    return absl::InvalidArgumentError(absl::StrCat(who, ": the image has ", image.cols, "x", image.rows,
                                                   " pixels, its camera ", camera.width_px, "x", camera.height_px));
  }
  return absl::OkStatus();
}

api::LensUse CorrectLens(const map::Snapshot& map, const image::Undistorter& undistorter, image::Features* features) {
  api::LensUse use = api::LensUse::kNone;
  for (const auto& [id, camera] : map.cameras()) {
    if (!camera.lens) continue;
    use = api::LensUse::kOtherCalibration;
    if (!map::SamePinhole(camera.pinhole, undistorter.pinhole())) continue;
    if (!map::SameCalibration(camera.model, undistorter.camera())) continue;
    map::CorrectKeypoints(camera, features->keypoints);
    return api::LensUse::kCorrected;
  }
  return use;
}

}  // namespace cairn::client
