// Images as clients send them, made gray.
#pragma once

#include <cairn/v1/types.pb.h>

#include <opencv2/core.hpp>

#include "base/status.h"
#include "geometry/camera.h"
#include "server/rpc/calls.h"

namespace cairn::server {

// InvalidArgument if images of this camera are larger than allowed.
absl::Status CheckImageSize(const Camera& camera, const ImageLimits& limits);

// CV_8UC1 of the size of `camera`, which has been validated. A gray image is not copied: `image` must outlive it.
// InvalidArgument if it is missing, of another size than the camera, of more pixels than allowed, or no whole PNG or
// JPEG; a file is not decoded before what its header says has been checked.
absl::StatusOr<cv::Mat> GrayImageOf(const v1::Image& image, const Camera& camera, const ImageLimits& limits);

}  // namespace cairn::server
