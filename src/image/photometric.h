// Photometric calibration: from the raw 8-bit intensity I of a pixel to the irradiance that hit the lens in its
// direction,
//   irradiance = G^-1(I) / V(x),
// with the inverse response G^-1 scaled to [0, 255] and the vignette V in (0, 1] (Engel, Usenko, Cremers, "A
// photometrically calibrated benchmark for monocular visual odometry", 2016). Exposure time is not divided out. To be
// applied to the raw, distorted image. Reading the files is in io/photometric_files.h.
//
// The odometry works on the irradiance under a power law,
//   corrected = 255 (irradiance / 255)^(1 / gamma),
// gamma being that of the power law nearest to the camera's response. Noise and contrast are then as even over dark and
// bright as in the raw image (in the irradiance of a camera with gamma 2.2 dark texture all but vanishes below
// thresholds in gray levels), and an exposure time remains what it is in the irradiance: a factor, exposure^(1 /
// gamma).
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "base/status.h"
#include "image/undistort.h"

namespace cairn::image {

class PhotometricCalibration {
 public:
  // No correction: irradiance equals intensity.
  PhotometricCalibration();

  // `inverse_response`: 256 strictly increasing finite numbers in any unit, or none for a linear sensor. `vignette`:
  // one channel, 8-bit, 16-bit or float, not negative, normalized here by its maximum; or empty for none.
  // InvalidArgument says what is wrong.
  static absl::StatusOr<PhotometricCalibration> Create(const std::vector<double>& inverse_response,
                                                       const cv::Mat& vignette);

  bool IsIdentity() const { return !has_response_ && gain_.empty(); }
  bool has_response() const { return has_response_; }
  bool has_vignette() const { return !gain_.empty(); }
  cv::Size vignette_size() const { return gain_.size(); }
  const std::array<float, 256>& inverse_response() const { return inverse_response_; }
  // Of the power law nearest to the response, in [kMinGamma, kMaxGamma]; 1 without a response.
  double gamma() const { return gamma_; }

  // InvalidArgument unless the vignette, if there is one, has the size of the camera's images.
  absl::Status ValidateFor(const Camera& camera) const;

  // CV_8UC1 raw image to CV_32FC1 irradiance: in [0, 255] where the vignette is 1, up to 255 / V elsewhere; the gain is
  // limited to kMaxGain. InvalidArgument for another type, or another size than the vignette's.
  absl::StatusOr<cv::Mat> Irradiance(const cv::Mat& raw) const;

  // Likewise, the irradiance under the power law.
  absl::StatusOr<cv::Mat> Corrected(const cv::Mat& raw) const;

  // The factor by which an exposure time in seconds multiplies the corrected image; 0, unknown, if the time is 0 or
  // there is no response.
  double ExposureGain(double exposure_s) const;

  static constexpr float kMaxGain = 20.0f;
  static constexpr double kMinGamma = 0.5;
  static constexpr double kMaxGamma = 4.0;

 private:
  absl::StatusOr<cv::Mat> Apply(const cv::Mat& raw, const std::array<float, 256>& table, const cv::Mat& gain) const;

  std::array<float, 256> inverse_response_;
  std::array<float, 256> corrected_;  // inverse_response_ under the power law
  double gamma_ = 1.0;
  bool has_response_ = false;
  cv::Mat gain_;            // CV_32FC1, 1 / V
  cv::Mat corrected_gain_;  // gain_ under the power law
};

// What the direct and the feature module get of one raw image.
struct PreparedImage {
  cv::Mat gray;       // CV_8UC1, undistorted, uncorrected
  cv::Mat corrected;  // CV_32FC1, corrected and undistorted; empty without a calibration: use `gray`
};

// Corrects the raw CV_8UC1 image and undistorts both results. `calibration` may be null.
absl::StatusOr<PreparedImage> PrepareImage(const cv::Mat& raw, const Undistorter& undistorter,
                                           const PhotometricCalibration* calibration);

}  // namespace cairn::image
