// Images as clients send them, made gray.
#pragma once

#include <cairn/v1/types.pb.h>

#include <opencv2/core.hpp>

#include "api/localizer.h"
#include "base/status.h"
#include "geometry/camera.h"
#include "server/rpc/calls.h"
#include "wire/convert.h"

namespace cairn::server {

// InvalidArgument if images of this camera are larger than allowed.
absl::Status CheckImageSize(const Camera& camera, const ImageLimits& limits);

// CV_8UC1 of the size of `camera`, which has been validated. A gray image is not copied: `image` must outlive it.
// InvalidArgument if it is missing, of another size than the camera, of more pixels than allowed, or no whole PNG or
// JPEG; a file is not decoded before what its header says has been checked.
absl::StatusOr<cv::Mat> GrayImageOf(const v1::Image& image, const Camera& camera, const ImageLimits& limits);

// What of an image came with a request: its features, if it has them, or else the image. InvalidArgument for both.
template <class Request>
absl::Status ReadContent(const Request& request, const ImageLimits& limits, api::LocalizeQuery* query) {
  if (!request.has_features()) {
    CAIRN_ASSIGN_OR_RETURN(query->image, GrayImageOf(request.image(), query->camera, limits));
    return absl::OkStatus();
  }
  if (request.has_image()) return absl::InvalidArgumentError("localize: give an image or its features, not both");
  CAIRN_RETURN_IF_ERROR(CheckImageSize(query->camera, limits));
  CAIRN_ASSIGN_OR_RETURN(query->features, wire::FromProto(request.features()));
  return absl::OkStatus();
}

}  // namespace cairn::server
