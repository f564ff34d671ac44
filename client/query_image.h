// What an image from outside must be before it is compared with a map: of its camera's size, undistorted, and its
// keypoints where the map's camera would have seen them.
#pragma once

#include <opencv2/core.hpp>

#include "api/localizer.h"
#include "base/status.h"
#include "geometry/camera.h"
#include "image/feature.h"
#include "image/undistort.h"
#include "map/snapshot.h"

namespace cairn::client {

// InvalidArgument, behind `who`: not CV_8UC1, empty, or of another size than the camera.
absl::Status CheckImage(const cv::Mat& image, const Camera& camera, const char* who);

// A camera that the map knows, by its calibration, and whose lens a session has corrected (map/lens.h): that of a query
// with the same calibration is the same.
api::LensUse CorrectLens(const map::Snapshot& map, const image::Undistorter& undistorter, image::Features* features);

}  // namespace cairn::client
