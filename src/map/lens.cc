#include "map/lens.h"

namespace cairn::map {

void CorrectKeypoints(const MapCamera& camera, std::span<image::Keypoint> keypoints) {
  if (!camera.lens) return;
  for (image::Keypoint& keypoint : keypoints) {
    const auto ideal = camera.lens->Ideal(camera.pinhole, {keypoint.x_px, keypoint.y_px});
    if (!ideal) continue;  // beyond what the polynomial describes: only outside any image
    keypoint.x_px = image::KeptPosition(static_cast<float>(ideal->x()));
    keypoint.y_px = image::KeptPosition(static_cast<float>(ideal->y()));
  }
}

}  // namespace cairn::map
