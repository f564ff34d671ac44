#include "io/intensity_range.h"

#include <algorithm>
#include <array>

#include "absl/strings/str_format.h"

namespace cairn::io {

std::string IntensityRange::Describe() const {
  if (*this == IntensityRange()) return "";
  return absl::StrFormat("the images have 16 bits; values from %.0f to %.0f become 0 to 255", black, white);
}

void IntensityStatistics::Add(const cv::Mat& image) {
  if (image.type() != CV_16UC1) return;
  for (int y = 0; y < image.rows; ++y) {
    const auto* row = image.ptr<std::uint16_t>(y);
    for (int x = 0; x < image.cols; ++x) ++histogram_[row[x]];
  }
  count_ += static_cast<std::int64_t>(image.total());
}

double IntensityStatistics::Percentile(double share) const {
  const auto wanted = static_cast<std::int64_t>(share * static_cast<double>(count_ - 1));
  std::int64_t below = 0;
  std::size_t value = 0;
  while (value + 1 < histogram_.size() && below + histogram_[value] <= wanted) below += histogram_[value++];
  return static_cast<double>(value);
}

IntensityRange IntensityStatistics::Range() const {
  if (empty()) return {};
  // A few hot and dead pixels say nothing.
  constexpr double kOutliers = 2e-4;
  const double low = Percentile(kOutliers), high = Percentile(1.0 - kOutliers);
  // The bits that sensors have; 8 bits in files of 16 as well.
  constexpr std::array<int, 5> kBits = {8, 10, 12, 14, 16};
  double most = 65535.0;
  for (const int bits : kBits) {
    most = static_cast<double>((1 << bits) - 1);
    if (high <= most) break;
  }
  // A window that thermal cameras use: a small part of the range, and not its dark end.
  constexpr double kSmallPart = 0.25, kMargin = 0.5, kLeastWidth = 64.0;
  const double width = high - low;
  if (width >= kSmallPart * most || low < width) return {0.0, most};
  const double margin = std::max(kMargin * width, 0.5 * (kLeastWidth - width));
  return {std::max(low - margin, 0.0), std::min(high + margin, 65535.0)};
}

void ToEightBits(const IntensityRange& range, cv::Mat* image) {
  if (image->depth() != CV_16U) return;
  const double scale = 255.0 / (range.white - range.black);
  image->convertTo(*image, CV_8U, scale, -range.black * scale);
}

}  // namespace cairn::io
