// The functions of the plain values in the public headers.
#include <Eigen/Core>
#include <cmath>

#include "api/localizer.h"
#include "api/tracker.h"
#include "base/guarded.h"
#include "base/status.h"
#include "base/version.h"
#include "cairn/answers.h"
#include "cairn/camera.h"
#include "cairn/image_view.h"
#include "cairn/pose.h"
#include "cairn/version.h"
#include "client/boundary/convert.h"
#include "geometry/se3.h"

namespace cairn::v0 {
namespace {

// One version everywhere.
static_assert(absl::string_view(CAIRN_VERSION) == kVersion && absl::string_view(CAIRN_VERSION) == CAIRN_BUILD_VERSION);

// The enumerators here are those of the modules, in the same order: one is the other's number
// (client/boundary/convert.cc), and names can be asked of the modules.
static_assert(static_cast<int>(LocalizeStage::kRefinement) == static_cast<int>(api::LocalizeStage::kRefinement));
static_assert(static_cast<int>(LocalizeStage::kRivals) == static_cast<int>(api::LocalizeStage::kRivals));
static_assert(static_cast<int>(LocalizeStage::kDone) == static_cast<int>(api::LocalizeStage::kDone));
static_assert(static_cast<int>(LensUse::kCorrected) == static_cast<int>(api::LensUse::kCorrected));
static_assert(static_cast<int>(LensUse::kOtherCalibration) == static_cast<int>(api::LensUse::kOtherCalibration));
static_assert(static_cast<int>(TrackState::kCarried) == static_cast<int>(api::TrackState::kCarried));
static_assert(static_cast<int>(TrackState::kLost) == static_cast<int>(api::TrackState::kLost));

Vector3d ToEigen(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }
std::array<double, 3> FromEigen(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }

SE3 ToSE3(const Pose& pose) {
  const std::array<double, 4>& q = pose.rotation_xyzw;
  return SE3::FromUnit(Quaterniond(q[3], q[0], q[1], q[2]), ToEigen(pose.translation));
}

Matrix3d PositionCovarianceMatrix(const Pose& map_from_camera, const PoseCovariance& covariance) {
  Eigen::Matrix<double, 3, 6> by_increment;  // of the camera's place
  by_increment << Matrix3d::Identity(), -Hat(ToEigen(map_from_camera.translation));
  const Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> matrix(covariance.data());
  return by_increment * matrix * by_increment.transpose();
}

}  // namespace

absl::Status ImageView::Validate() const noexcept {
  return Guarded([&]() -> absl::Status {
    if (data == nullptr || width_px <= 0 || height_px <= 0) {
      return absl::InvalidArgumentError(absl::StrCat("image: ", width_px, "x", height_px, " pixels at ",
                                                     data == nullptr ? "no address" : "an address",
                                                     ": there is no image"));
    }
    if (format != PixelFormat::kGray8 && format != PixelFormat::kRgb8 && format != PixelFormat::kBgr8) {
      return absl::InvalidArgumentError(absl::StrCat("image: there is no pixel format ", static_cast<int>(format)));
    }
    const std::ptrdiff_t row = std::ptrdiff_t{width_px} * (format == PixelFormat::kGray8 ? 1 : 3);
    if (stride_bytes != 0 && stride_bytes < row) {
      return absl::InvalidArgumentError(
          absl::StrCat("image: a stride of ", stride_bytes, " bytes is shorter than a row of ", row));
    }
    return absl::OkStatus();
  });
}

absl::Status Camera::Validate() const noexcept {
  return Guarded([&]() -> absl::Status {
    CAIRN_ASSIGN_OR_RETURN(const cairn::Camera internal, client::ToInternal(*this));
    return internal.Validate();
  });
}

std::array<double, 3> Transform(const Pose& a_from_b, const std::array<double, 3>& point_b) noexcept {
  return FromEigen(ToSE3(a_from_b) * ToEigen(point_b));
}

Pose Compose(const Pose& a_from_b, const Pose& b_from_c) noexcept {
  return client::ToPublic(ToSE3(a_from_b) * ToSE3(b_from_c));
}

Pose Inverse(const Pose& a_from_b) noexcept { return client::ToPublic(ToSE3(a_from_b).Inverse()); }

std::array<double, 9> PositionCovariance(const Pose& map_from_camera, const PoseCovariance& covariance) noexcept {
  const Matrix3d matrix = PositionCovarianceMatrix(map_from_camera, covariance);
  std::array<double, 9> result;
  for (int i = 0; i < 9; ++i) result[static_cast<std::size_t>(i)] = matrix(i / 3, i % 3);
  return result;
}

double PositionSigma(const Pose& map_from_camera, const PoseCovariance& covariance) noexcept {
  return std::sqrt(PositionCovarianceMatrix(map_from_camera, covariance).trace());
}

double RotationSigmaRad(const PoseCovariance& covariance) noexcept {
  return std::sqrt(covariance[21] + covariance[28] + covariance[35]);
}

const char* LocalizeStageName(LocalizeStage stage) noexcept {
  return api::LocalizeStageName(static_cast<api::LocalizeStage>(stage));
}

const char* LensUseName(LensUse use) noexcept { return api::LensUseName(static_cast<api::LensUse>(use)); }

const char* TrackStateName(TrackState state) noexcept {
  return api::TrackStateName(static_cast<api::TrackState>(state));
}

}  // namespace cairn::v0
