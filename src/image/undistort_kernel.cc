#include "image/undistort_kernel.h"

#include "base/cpu_features.h"
#include "image/undistort_kernel.inl"

namespace cairn::image {
namespace {

template <class T>
void Row(const RawImage<T>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int count, T* out) {
  PlainPixels(raw, xy, fraction, 0, count, out);
}

}  // namespace

const UndistortKernels internal::kUndistortBaseline = {Row<std::uint8_t>, Row<float>};

const UndistortKernels& UndistortKernelsFor(SimdLevel level) {
  return level == SimdLevel::kBaseline ? internal::kUndistortBaseline : internal::kUndistortAvx2;
}

}  // namespace cairn::image
