// How images of 16 bits become ones of 8: cameras fill 10, 12 or 14 of them, thermal cameras a window somewhere in the
// middle. One range serves a whole sequence, so that brightness stays comparable from image to image.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace cairn::io {

// Values from black to white become 0 to 255; what is beyond is cut off.
struct IntensityRange {
  double black = 0.0;
  double white = 65535.0;

  bool operator==(const IntensityRange&) const = default;
  // What was found, for people; empty if all 16 bits are used.
  std::string Describe() const;
};

// From images spread over the sequence.
class IntensityStatistics {
 public:
  // CV_16UC1; others are left out.
  void Add(const cv::Mat& image);
  bool empty() const { return count_ == 0; }
  // As many bits as the brightest values need, or, where the values fill but a small part of those, that part with a
  // margin for images that are brighter or darker.
  IntensityRange Range() const;

 private:
  double Percentile(double share) const;

  std::vector<std::int64_t> histogram_ = std::vector<std::int64_t>(65536, 0);
  std::int64_t count_ = 0;
};

// CV_8UC1 from CV_16UC1; 8-bit images stay as they are.
void ToEightBits(const IntensityRange& range, cv::Mat* image);

}  // namespace cairn::io
