// From an image as the camera gives it to the frame that odometry and feature module see: photometric correction and
// undistortion.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>

#include "base/status.h"
#include "base/time.h"
#include "direct/packet.h"
#include "engine/session_record.h"
#include "geometry/pinhole.h"
#include "image/photometric.h"
#include "image/undistort.h"

namespace cairn::engine {

struct RawFrame {
  std::int64_t index = 0;
  TimeNs time_ns = 0;
  cv::Mat gray;  // CV_8UC1, as the camera gives it
  double exposure_s = 0.0;
};

class FramePreparation {
 public:
  // InvalidArgument or FailedPrecondition for a camera or a calibration that cannot be used.
  static absl::StatusOr<FramePreparation> Create(const SessionSource& source);
  // Leaves images as the camera gives them, whatever their size: for whom somebody else prepares them.
  static absl::StatusOr<FramePreparation> Untouched(const Camera& camera);

  // InvalidArgument for an image that does not fit the camera. Safe from several threads at once.
  absl::StatusOr<direct::Frame> Prepare(const RawFrame& raw) const;

  // Of the prepared images, at full resolution; of untouched ones without their distortion.
  const Pinhole& pinhole() const { return undistorter_ ? undistorter_->pinhole() : untouched_; }

 private:
  FramePreparation() = default;

  std::optional<image::Undistorter> undistorter_;
  Pinhole untouched_;  // without an undistorter
  std::optional<image::PhotometricCalibration> photometric_;
};

}  // namespace cairn::engine
