#include "image/photometric.h"

#include <algorithm>
#include <cmath>

namespace cairn::image {

namespace {

float UnderPowerLaw(float light, double gamma) {
  return static_cast<float>(255.0 * std::pow(light / 255.0, 1.0 / gamma));
}

// By golden section: the squared distance between the encoded and the raw intensities has one minimum over gamma.
double NearestGamma(const std::array<float, 256>& inverse_response) {
  const auto distance = [&](double gamma) {
    double sum = 0.0;
    for (int i = 0; i < 256; ++i) {
      const double off = UnderPowerLaw(inverse_response[i], gamma) - i;
      sum += off * off;
    }
    return sum;
  };
  constexpr double kGolden = 0.6180339887498949;
  double low = PhotometricCalibration::kMinGamma, high = PhotometricCalibration::kMaxGamma;
  double a = high - kGolden * (high - low), b = low + kGolden * (high - low);
  double at_a = distance(a), at_b = distance(b);
  while (high - low > 1e-6) {
    if (at_a < at_b) {
      high = b, b = a, at_b = at_a;
      a = high - kGolden * (high - low), at_a = distance(a);
    } else {
      low = a, a = b, at_a = at_b;
      b = low + kGolden * (high - low), at_b = distance(b);
    }
  }
  return 0.5 * (low + high);
}

}  // namespace

PhotometricCalibration::PhotometricCalibration() {
  for (int i = 0; i < 256; ++i) inverse_response_[i] = corrected_[i] = static_cast<float>(i);
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
    out.gamma_ = NearestGamma(out.inverse_response_);
    for (int i = 0; i < 256; ++i) out.corrected_[i] = UnderPowerLaw(out.inverse_response_[i], out.gamma_);
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
    cv::pow(values, 1.0 / out.gamma_, out.corrected_gain_);
  }
  return out;
}

absl::Status PhotometricCalibration::ValidateFor(const Camera& camera) const {
  if (gain_.empty() || (gain_.cols == camera.width_px && gain_.rows == camera.height_px)) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("the vignette has ", gain_.cols, "x", gain_.rows,
                                                 " px but the camera ", camera.width_px, "x", camera.height_px, " px"));
}

absl::StatusOr<cv::Mat> PhotometricCalibration::Irradiance(const cv::Mat& raw) const {
  return Apply(raw, inverse_response_, gain_);
}

absl::StatusOr<cv::Mat> PhotometricCalibration::Corrected(const cv::Mat& raw) const {
  return Apply(raw, corrected_, corrected_gain_);
}

double PhotometricCalibration::ExposureGain(double exposure_s) const {
  return has_response_ && exposure_s > 0.0 ? std::pow(exposure_s, 1.0 / gamma_) : 0.0;
}

absl::StatusOr<cv::Mat> PhotometricCalibration::Apply(const cv::Mat& raw, const std::array<float, 256>& table,
                                                      const cv::Mat& gain_image) const {
  if (raw.type() != CV_8UC1) return absl::InvalidArgumentError("photometric correction needs a gray image of 8 bits");
  if (!gain_.empty() && gain_.size() != raw.size()) {
    return absl::InvalidArgumentError(absl::StrCat("the image has ", raw.cols, "x", raw.rows, " px but the vignette ",
                                                   gain_.cols, "x", gain_.rows, " px"));
  }
  cv::Mat out(raw.size(), CV_32FC1);
  for (int y = 0; y < raw.rows; ++y) {
    const std::uint8_t* in = raw.ptr<std::uint8_t>(y);
    float* light = out.ptr<float>(y);
    if (gain_image.empty()) {
      for (int x = 0; x < raw.cols; ++x) light[x] = table[in[x]];
    } else {
      const float* gain = gain_image.ptr<float>(y);
      for (int x = 0; x < raw.cols; ++x) light[x] = table[in[x]] * gain[x];
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
    CAIRN_ASSIGN_OR_RETURN(const cv::Mat corrected, calibration->Corrected(raw));
    CAIRN_ASSIGN_OR_RETURN(out.corrected, undistorter.Undistort(corrected));
  }
  return out;
}

}  // namespace cairn::image
