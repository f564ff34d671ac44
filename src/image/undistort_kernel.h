// The inner loop of undistortion: one row of the output, bilinear in 1/32 px, pixels outside the raw image black. The
// maps are those of cv::convertMaps (CV_16SC2 and CV_16UC1); bytes come out exactly as from cv::remap. Plain pointers.
#pragma once

#include <cstddef>
#include <cstdint>

namespace cairn {
enum class SimdLevel;  // base/cpu_features.h
}

namespace cairn::image {

template <class T>
struct RawImage {
  const T* data = nullptr;
  std::ptrdiff_t stride = 0;  // elements from row to row, less than 2^31 / height
  int width = 0, height = 0;
};

struct UndistortKernels {
  // `xy`: the upper left of the four pixels around each position, x and y in turn; `fraction`: 32 * y + x, in 1/32 px.
  void (*bytes)(const RawImage<std::uint8_t>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int count,
                std::uint8_t* out);
  void (*floats)(const RawImage<float>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int count,
                 float* out);
};

const UndistortKernels& UndistortKernelsFor(SimdLevel level);

namespace internal {
extern const UndistortKernels kUndistortBaseline, kUndistortAvx2;
}  // namespace internal

}  // namespace cairn::image
