#include "image/photometric_tracks.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>

#include "absl/strings/str_cat.h"

namespace cairn::image {
namespace {

constexpr int kSpotReach = 6;      // of a spot from its corner, px
constexpr int kPatchRadius = 7;    // of what is compared
constexpr int kBorder = 12;        // px
constexpr int kLevels = 3;         // of the pyramid beyond the image
constexpr double kLocalSigma = 8;  // of the neighbourhood that brightness is taken from, px
const cv::Size kWindow(17, 17);

cv::Mat Normalized(const cv::Mat& gray) {
  cv::Mat image, mean, square, out;
  gray.convertTo(image, CV_32F);
  cv::boxFilter(image, mean, CV_32F, cv::Size(2 * kLocalSigma + 1, 2 * kLocalSigma + 1));
  cv::sqrBoxFilter(image, square, CV_32F, cv::Size(2 * kLocalSigma + 1, 2 * kLocalSigma + 1));
  cv::Mat deviation;
  cv::sqrt(cv::max(square - mean.mul(mean), 0.0f), deviation);
  // Three gray levels: flat neighbourhoods are not blown up to noise.
  image = (image - mean) / (deviation + 3.0f);
  image.convertTo(out, CV_8U, 40.0, 128.0);
  return out;
}

cv::Mat PatchAt(const cv::Mat& image, cv::Point2f at) {
  cv::Mat patch;
  cv::getRectSubPix(image, cv::Size(2 * kPatchRadius + 1, 2 * kPatchRadius + 1), at, patch);
  return patch;
}

double Correlation(const cv::Mat& a, const cv::Mat& b) {
  cv::Mat result;
  cv::matchTemplate(a, b, result, cv::TM_CCOEFF_NORMED);
  return result.at<float>(0, 0);
}

float Bilinear(const cv::Mat& image, cv::Point2f at) {
  const int x = static_cast<int>(at.x), y = static_cast<int>(at.y);
  const float u = at.x - static_cast<float>(x), v = at.y - static_cast<float>(y);
  const float* a = image.ptr<float>(y) + x;
  const float* b = image.ptr<float>(y + 1) + x;
  return (1 - v) * ((1 - u) * a[0] + u * a[1]) + v * ((1 - u) * b[0] + u * b[1]);
}

float Gradient(const cv::Mat& image, cv::Point2f at) {
  const float dx = 0.5f * (Bilinear(image, at + cv::Point2f(1, 0)) - Bilinear(image, at - cv::Point2f(1, 0)));
  const float dy = 0.5f * (Bilinear(image, at + cv::Point2f(0, 1)) - Bilinear(image, at - cv::Point2f(0, 1)));
  return std::hypot(dx, dy);
}

bool Inside(cv::Point2f at, cv::Size size) {
  return at.x >= kBorder && at.y >= kBorder && at.x < static_cast<float>(size.width - kBorder) &&
         at.y < static_cast<float>(size.height - kBorder);
}

}  // namespace

absl::Status PhotometricTrackOptions::Validate() const {
  if (max_corners < 10) return absl::InvalidArgumentError("max_corners must be at least 10");
  if (!(min_distance_px >= 1.0)) return absl::InvalidArgumentError("min_distance_px must be at least 1");
  if (!(max_backward_px > 0.0)) return absl::InvalidArgumentError("max_backward_px must be positive");
  if (!(min_correlation < 1.0)) return absl::InvalidArgumentError("min_correlation must be below 1");
  if (max_samples < 2) return absl::InvalidArgumentError("max_samples must be at least 2");
  if (!(noise_gray > 0.0 && position_px >= 0.0)) {
    return absl::InvalidArgumentError("noise_gray must be positive and position_px not negative");
  }
  return absl::OkStatus();
}

absl::Status PhotometricTracker::Add(const cv::Mat& gray, bool sample) {
  if (gray.type() != CV_8UC1 || gray.cols < 64 || gray.rows < 48 || (frames_ > 0 && gray.size() != size_)) {
    return absl::InvalidArgumentError(
        absl::StrCat("photometric calibration needs 8-bit gray images of one size, at least 64x48 px, not ", gray.cols,
                     "x", gray.rows, " px of OpenCV type ", gray.type()));
  }
  size_ = gray.size();
  const cv::Mat normalized = Normalized(gray);
  Follow(normalized);
  if (sample) {
    Replenish(gray, normalized);
    Sample(gray, normalized);
    ++frames_;
  }
  return absl::OkStatus();
}

void PhotometricTracker::Drop(const Corner& corner) {
  if (corner.samples < 2) return;
  const cv::Point2f way = corner.at - corner.born;
  paths_.push_back(std::hypot(way.x, way.y) /
                   std::hypot(static_cast<float>(size_.width), static_cast<float>(size_.height)));
}

double PhotometricTracker::MedianPath() const {
  std::vector<float> paths = paths_;
  if (paths.empty()) return 0.0;
  std::nth_element(paths.begin(), paths.begin() + static_cast<std::ptrdiff_t>(paths.size() / 2), paths.end());
  return paths[paths.size() / 2];
}

void PhotometricTracker::Follow(const cv::Mat& normalized) {
  std::vector<cv::Mat> pyramid;
  cv::buildOpticalFlowPyramid(normalized, pyramid, kWindow, kLevels);
  if (!corners_.empty()) {
    std::vector<cv::Point2f> from, to, back;
    for (const Corner& corner : corners_) from.push_back(corner.at);
    std::vector<unsigned char> found, found_back;
    std::vector<float> error;
    const cv::TermCriteria criteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 20, 0.02);
    cv::calcOpticalFlowPyrLK(last_, pyramid, from, to, found, error, kWindow, kLevels, criteria);
    cv::calcOpticalFlowPyrLK(pyramid, last_, to, back, found_back, error, kWindow, kLevels, criteria);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < corners_.size(); ++i) {
      const cv::Point2f off = back[i] - from[i];
      if (found[i] && found_back[i] && std::hypot(off.x, off.y) <= options_.max_backward_px && Inside(to[i], size_)) {
        if (kept != i) corners_[kept] = std::move(corners_[i]);
        corners_[kept++].at = to[i];
      } else {
        Drop(corners_[i]);
      }
    }
    corners_.resize(kept);
  }
  last_ = std::move(pyramid);
}

void PhotometricTracker::Sample(const cv::Mat& gray, const cv::Mat& normalized) {
  cv::Mat smooth;
  cv::boxFilter(gray, smooth, CV_32F, cv::Size(3, 3));
  const double half_diagonal = 0.5 * std::hypot(size_.width - 1.0, size_.height - 1.0);
  std::size_t kept = 0;
  for (std::size_t i = 0; i < corners_.size(); ++i) {
    Corner& corner = corners_[i];
    cv::Mat patch = PatchAt(normalized, corner.at);
    const bool same = corner.patch.empty() || Correlation(patch, corner.patch) >= options_.min_correlation;
    if (!same || corner.samples >= options_.max_samples) {
      Drop(corner);
      continue;
    }
    corner.patch = patch;
    ++corner.samples;
    for (int side = 0; side < 2; ++side) {
      if (corner.point[side] < 0) continue;
      const cv::Point2f at = corner.at + corner.spot[side];
      PhotometricSample sample;
      sample.point = corner.point[side];
      sample.frame = frames_;
      sample.radius =
          std::min(1.0, std::hypot(at.x - 0.5 * (size_.width - 1), at.y - 0.5 * (size_.height - 1)) / half_diagonal);
      sample.intensity = Bilinear(smooth, at);
      sample.sigma_gray = std::hypot(options_.noise_gray, options_.position_px * Gradient(smooth, at));
      samples_.push_back(sample);
    }
    if (kept != i) corners_[kept] = std::move(corner);
    ++kept;
  }
  corners_.resize(kept);
}

// The flattest spots among those darker and among those brighter than the neighbourhood's mean.
bool PhotometricTracker::FindSpots(const cv::Mat& smooth, Corner* corner) {
  const cv::Point2f at = corner->at;
  const cv::Rect around(static_cast<int>(at.x) - kSpotReach, static_cast<int>(at.y) - kSpotReach, 2 * kSpotReach + 1,
                        2 * kSpotReach + 1);
  const double mean = cv::mean(smooth(around))[0];
  float flattest[2] = {1e9f, 1e9f};
  bool any = false;
  for (int dy = -kSpotReach; dy <= kSpotReach; ++dy) {
    for (int dx = -kSpotReach; dx <= kSpotReach; ++dx) {
      const cv::Point2f offset(static_cast<float>(dx), static_cast<float>(dy));
      const int side = Bilinear(smooth, at + offset) < mean ? 0 : 1;
      const float gradient = Gradient(smooth, at + offset);
      if (gradient >= flattest[side]) continue;
      flattest[side] = gradient;
      corner->spot[side] = offset;
    }
  }
  for (int side = 0; side < 2; ++side) {
    if (flattest[side] > 1e8f) continue;
    corner->point[side] = points_++;
    any = true;
  }
  return any;
}

void PhotometricTracker::Replenish(const cv::Mat& gray, const cv::Mat& normalized) {
  const int missing = options_.max_corners - static_cast<int>(corners_.size());
  if (missing < options_.max_corners / 5) return;
  cv::Mat mask(size_, CV_8UC1, cv::Scalar(0)), smooth;
  mask(cv::Rect(kBorder, kBorder, size_.width - 2 * kBorder, size_.height - 2 * kBorder)) = 255;
  for (const Corner& corner : corners_) {
    cv::circle(mask, corner.at, static_cast<int>(options_.min_distance_px), cv::Scalar(0), cv::FILLED);
  }
  std::vector<cv::Point2f> found;
  cv::goodFeaturesToTrack(normalized, found, missing, 0.01, options_.min_distance_px, mask, 5);
  cv::boxFilter(gray, smooth, CV_32F, cv::Size(3, 3));
  for (const cv::Point2f& at : found) {
    Corner corner;
    corner.at = corner.born = at;
    if (!Inside(at, size_) || !FindSpots(smooth, &corner)) continue;
    corners_.push_back(std::move(corner));
  }
}

}  // namespace cairn::image
