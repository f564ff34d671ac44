#include "image/photometric.h"

#include <algorithm>
#include <cmath>

namespace cairn::image {

PhotometricCalibration::PhotometricCalibration() {
  for (int i = 0; i < 256; ++i) inverse_response_[i] = static_cast<float>(i);
}

absl::StatusOr<PhotometricCalibration> PhotometricCalibration::Create(const std::vector<double>& inverse_response,
                                                                      const cv::Mat& vignette) {
  PhotometricCalibration out;
  if (!inverse_response.empty()) {
    if (inverse_response.size() != 256) {
      return absl::InvalidArgumentError(
          absl::StrCat("the response has ", inverse_response.size(), " values, not 256, one per intensity"));
    }
    for (int i = 0; i < 256; ++i) {
      if (!std::isfinite(inverse_response[i]) || (i > 0 && inverse_response[i] <= inverse_response[i - 1])) {
        return absl::InvalidArgumentError(absl::StrCat("the response must increase strictly, but its value ", i + 1,
                                                       " is ", inverse_response[i],
                                                       i > 0 ? absl::StrCat(" after ", inverse_response[i - 1]) : ""));
      }
    }
    const double low = inverse_response.front(), range = inverse_response.back() - low;
    for (int i = 0; i < 256; ++i) {
      out.inverse_response_[i] = static_cast<float>(255.0 * (inverse_response[i] - low) / range);
    }
    out.has_response_ = true;
  }
  if (!vignette.empty()) {
    if (vignette.channels() != 1 ||
        (vignette.depth() != CV_8U && vignette.depth() != CV_16U && vignette.depth() != CV_32F)) {
      return absl::InvalidArgumentError("the vignette must be a gray image of 8 or 16 bits");
    }
    cv::Mat values;
    vignette.convertTo(values, CV_32F);
    float brightest = 0.0f;
    for (int y = 0; y < values.rows; ++y) {
      for (int x = 0; x < values.cols; ++x) {
        const float v = values.at<float>(y, x);
        if (!std::isfinite(v) || v < 0.0f) {
          return absl::InvalidArgumentError(absl::StrCat("the vignette is ", v, " at pixel (", x, ", ", y, ")"));
        }
        brightest = std::max(brightest, v);
      }
    }
    if (brightest == 0.0f) return absl::InvalidArgumentError("the vignette is black everywhere");
    values.forEach<float>(
        [brightest](float& v, const int*) { v = v * kMaxGain > brightest ? brightest / v : kMaxGain; });
    out.gain_ = values;
  }
  return out;
}

absl::Status PhotometricCalibration::ValidateFor(const Camera& camera) const {
  if (gain_.empty() || (gain_.cols == camera.width_px && gain_.rows == camera.height_px)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("the vignette has ", gain_.cols, "x", gain_.rows,
                                                 " px but the camera ", camera.width_px, "x", camera.height_px, " px"));
}

absl::StatusOr<cv::Mat> PhotometricCalibration::Irradiance(const cv::Mat& raw) const {
  if (raw.type() != CV_8UC1) return absl::InvalidArgumentError("irradiance needs a gray image of 8 bits");
  if (!gain_.empty() && gain_.size() != raw.size()) {
    return absl::InvalidArgumentError(absl::StrCat("the image has ", raw.cols, "x", raw.rows, " px but the vignette ",
                                                   gain_.cols, "x", gain_.rows, " px"));
  }
  cv::Mat out(raw.size(), CV_32FC1);
  for (int y = 0; y < raw.rows; ++y) {
    const std::uint8_t* in = raw.ptr<std::uint8_t>(y);
    float* irradiance = out.ptr<float>(y);
    if (gain_.empty()) {
      for (int x = 0; x < raw.cols; ++x) irradiance[x] = inverse_response_[in[x]];
    } else {
      const float* gain = gain_.ptr<float>(y);
      for (int x = 0; x < raw.cols; ++x) irradiance[x] = inverse_response_[in[x]] * gain[x];
    }
  }
  return out;
}

absl::StatusOr<PreparedImage> PrepareImage(const cv::Mat& raw, const Undistorter& undistorter,
                                           const PhotometricCalibration* calibration) {
  if (raw.type() != CV_8UC1) return absl::InvalidArgumentError("a gray image of 8 bits is needed");
  PreparedImage out;
  CAIRN_ASSIGN_OR_RETURN(out.gray, undistorter.Undistort(raw));
  if (calibration != nullptr && !calibration->IsIdentity()) {
    CAIRN_ASSIGN_OR_RETURN(const cv::Mat irradiance, calibration->Irradiance(raw));
    CAIRN_ASSIGN_OR_RETURN(out.irradiance, undistorter.Undistort(irradiance));
  }
  return out;
}

}  // namespace cairn::image
