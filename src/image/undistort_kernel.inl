// One pixel of undistortion, in every file of the kernel. See undistort_kernel.h.
#include "image/undistort_kernel.h"

namespace cairn::image {
namespace {

inline std::uint8_t Blend(std::uint8_t p0, std::uint8_t p1, std::uint8_t q0, std::uint8_t q1, int fx, int fy) {
  const int top = p0 * (32 - fx) + p1 * fx, low = q0 * (32 - fx) + q1 * fx;
  return static_cast<std::uint8_t>((top * (32 - fy) + low * fy + 512) >> 10);
}

inline float Blend(float p0, float p1, float q0, float q1, int fx, int fy) {
  const float ax = static_cast<float>(fx) / 32.0f, ay = static_cast<float>(fy) / 32.0f;
  const float top = p0 + ax * (p1 - p0), low = q0 + ax * (q1 - q0);
  return top + ay * (low - top);
}

// With any of its four pixels outside.
template <class T>
[[gnu::noinline]] T BorderPixel(const RawImage<T>& raw, int x, int y, int fx, int fy) {
  const auto at = [&raw](int column, int row) {
    const bool inside = column >= 0 && row >= 0 && column < raw.width && row < raw.height;
    return inside ? raw.data[row * raw.stride + column] : T();
  };
  return Blend(at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y + 1), fx, fy);
}

template <class T>
inline void PlainPixels(const RawImage<T>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int begin,
                        int end, T* out) {
  for (int i = begin; i < end; ++i) {
    const int x = xy[2 * i], y = xy[2 * i + 1], fx = fraction[i] & 31, fy = fraction[i] >> 5;
    if (x < 0 || y < 0 || x + 1 >= raw.width || y + 1 >= raw.height) {
      out[i] = BorderPixel(raw, x, y, fx, fy);
      continue;
    }
    const T* p = raw.data + y * raw.stride + x;
    out[i] = Blend(p[0], p[1], p[raw.stride], p[raw.stride + 1], fx, fy);
  }
}

}  // namespace
}  // namespace cairn::image
