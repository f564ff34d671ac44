// Keypoints of a camera whose lens a session has found to differ from its calibration.
#pragma once

#include <span>

#include "map/entities.h"

namespace cairn::map {

// From where they appear in the undistorted image to where camera.pinhole would have seen them, kept to 1/32 px like
// all keypoints. Does nothing for a camera without a lens correction.
void CorrectKeypoints(const MapCamera& camera, std::span<image::Keypoint> keypoints);

}  // namespace cairn::map
