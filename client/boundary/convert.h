// Values of the public headers (client/include/cairn) from those of the modules, and back. Public ones are in
// cairn::v0.
#pragma once

#include <opencv2/core.hpp>

#include "api/localizer.h"
#include "api/tracker.h"
#include "base/status.h"
#include "cairn/answers.h"
#include "cairn/call_options.h"
#include "cairn/camera.h"
#include "cairn/image_view.h"
#include "cairn/localizer.h"
#include "cairn/map.h"
#include "cairn/pose.h"
#include "client/remote/server_access.h"
#include "geometry/camera.h"
#include "map/snapshot.h"

namespace cairn::client {

// DeadlineExceeded or Cancelled, if it is so now. `what` is for the message: "localize".
absl::Status CheckCall(const v0::CallOptions& call, absl::string_view what);

// InvalidArgument for a model that there is not; Validate() is left to who uses it.
absl::StatusOr<Camera> ToInternal(const v0::Camera& camera);
v0::Camera ToPublic(const Camera& camera);
// InvalidArgument for a quaternion that is not of unit length.
absl::StatusOr<api::PosePrior> ToInternal(const v0::PosePrior& prior);

ServerAccess ToInternal(const v0::ServerOptions& server);

// CV_8UC1. A grey view's pixels are referred to, not copied, and must not be written to.
absl::StatusOr<cv::Mat> GrayImage(const v0::ImageView& view);

v0::Pose ToPublic(const SE3& a_from_b);
v0::PoseCovariance ToPublic(const Matrix6d& covariance);
v0::LocalizeAnswer ToPublic(const api::LocalizeAnswer& answer);
v0::TrackAnswer ToPublic(const api::TrackAnswer& answer);

v0::MapInfo InfoOf(const map::Snapshot& map);

}  // namespace cairn::client
