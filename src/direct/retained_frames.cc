#include "direct/retained_frames.h"

#include <algorithm>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace cairn::direct {

namespace {

// Small enough that noise averages out, large enough to see a motion of a hundredth of the view.
constexpr int kThumbnailWidth = 40;
constexpr double kStill = 0.5;  // gray values on average: noise, and light that flickers

cv::Mat SmallView(const cv::Mat& image) {
  if (image.empty()) return {};
  cv::Mat thumbnail;
  const int height = std::max(1, image.rows * kThumbnailWidth / image.cols);
  cv::resize(image, thumbnail, {kThumbnailWidth, height}, 0, 0, cv::INTER_AREA);
  thumbnail.convertTo(thumbnail, CV_32F);
  return thumbnail - cv::mean(thumbnail)[0];
}

// How much two views differ; 0 for views of a camera that stands.
double ViewDifference(const RetainedFrame& a, const RetainedFrame& b) {
  if (a.thumbnail.empty() || a.thumbnail.size() != b.thumbnail.size()) return 0.0;
  const double mean = cv::norm(a.thumbnail, b.thumbnail, cv::NORM_L1) / static_cast<double>(a.thumbnail.total());
  return std::max(mean - kStill, 0.0);
}

}  // namespace

void RetainedFrames::Add(const Frame& frame, std::size_t position) {
  start_.push_back({frame, position, SmallView(frame.image)});
}

void RetainedFrames::Thin() {
  while (reference_ > max_before_reference_) {
    std::size_t goes = 1;
    std::pair<double, TimeNs> closest = {std::numeric_limits<double>::max(), 0};
    for (std::size_t i = 1; i < reference_; ++i) {
      const RetainedFrame &before = start_[i - 1], &after = start_[i + 1];
      const std::pair<double, TimeNs> between = {ViewDifference(before, after),
                                                 after.frame.time_ns - before.frame.time_ns};
      if (between < closest) closest = between, goes = i;
    }
    start_.erase(start_.begin() + static_cast<std::ptrdiff_t>(goes));
    --reference_;
  }
}

void RetainedFrames::ClearStart() {
  start_.clear();
  reference_ = 0;
}

}  // namespace cairn::direct
