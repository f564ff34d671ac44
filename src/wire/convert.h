// Messages of cairn.v1 to values and back. What comes from outside is checked as it is read: InvalidArgument names the
// field that makes no sense. Numbers arrive as they were sent, to the bit.
#pragma once

#include <cairn/v1/localize.pb.h>
#include <cairn/v1/maps.pb.h>
#include <cairn/v1/types.pb.h>

#include <opencv2/core.hpp>
#include <optional>

#include "api/localizer.h"
#include "api/map_service.h"
#include "base/status.h"
#include "geometry/camera.h"
#include "geometry/se3.h"

namespace cairn::wire {

void ToProto(const SE3& pose, v1::Pose* out);
void ToProto(const Sim3& similarity, v1::Similarity* out);
void ToProto(const Camera& camera, v1::Camera* out);
void ToProto(const cv::Mat& gray, v1::Image* out);  // CV_8UC1
void ToProto(const api::PosePrior& prior, v1::PosePrior* out);
void ToProto(const image::OrbParameters& orb, v1::OrbParameters* out);
void ToProto(const api::ImageFeatures& features, v1::ImageFeatures* out);
void ToProto(const api::LocalizeAnswer& answer, v1::LocalizeImageResponse* out);
void ToProto(const api::AcrossAnswer& across, v1::LocalizeInMapsResponse* out);
void ToProto(const api::MapSummary& summary, v1::MapSummary* out);
void ToProto(const api::MapDescription& description, v1::DescribeMapResponse* out);

// Quaternions are of unit length within 1e-6, and all numbers finite.
absl::StatusOr<SE3> FromProto(const v1::Pose& message);
absl::StatusOr<Sim3> FromProto(const v1::Similarity& message);
absl::StatusOr<Camera> FromProto(const v1::Camera& message);
absl::StatusOr<api::PosePrior> FromProto(const v1::PosePrior& message);
absl::StatusOr<image::OrbParameters> FromProto(const v1::OrbParameters& message);
// At most api::kMaxImageFeatures, each of an octave that there is and within the image.
absl::StatusOr<api::ImageFeatures> FromProto(const v1::ImageFeatures& message);
absl::StatusOr<api::LocalizeAnswer> FromProto(const v1::LocalizeImageResponse& message);
absl::StatusOr<api::AcrossAnswer> FromProto(const v1::LocalizeInMapsResponse& message);
absl::StatusOr<api::MapSummary> FromProto(const v1::MapSummary& message);
absl::StatusOr<api::MapDescription> FromProto(const v1::DescribeMapResponse& message);

}  // namespace cairn::wire
