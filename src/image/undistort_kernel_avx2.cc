#include <immintrin.h>

#include "image/undistort_kernel.h"
#include "image/undistort_kernel.inl"

namespace cairn::image {
namespace {

// Positions of eight pixels in the raw image.
struct Eight {
  __m256i index;  // elements
  __m256i fx, fy;
  bool inside;  // all of them with `reach` columns and one row behind
};

inline Eight Load(const std::int16_t* xy, const std::uint16_t* fraction, int width, int height, int stride, int reach) {
  const __m256i pairs = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(xy));
  const __m256i x = _mm256_srai_epi32(_mm256_slli_epi32(pairs, 16), 16), y = _mm256_srai_epi32(pairs, 16);
  const __m256i f = _mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(fraction)));
  // Compared as unsigned numbers, what is negative is too large.
  const __m256i x_last = _mm256_set1_epi32(width - 1 - reach), y_last = _mm256_set1_epi32(height - 2);
  const __m256i inside = _mm256_and_si256(_mm256_cmpeq_epi32(_mm256_min_epu32(x, x_last), x),
                                          _mm256_cmpeq_epi32(_mm256_min_epu32(y, y_last), y));
  Eight e;
  e.index = _mm256_add_epi32(_mm256_mullo_epi32(y, _mm256_set1_epi32(stride)), x);
  e.fx = _mm256_and_si256(f, _mm256_set1_epi32(31));
  e.fy = _mm256_srli_epi32(f, 5);
  e.inside = width > reach && height > 1 && _mm256_movemask_epi8(inside) == -1;
  return e;
}

void Bytes(const RawImage<std::uint8_t>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int count,
           std::uint8_t* out) {
  const int stride = static_cast<int>(raw.stride);
  const __m256i all = _mm256_set1_epi32(32), half = _mm256_set1_epi32(512);
  const __m256i low_bytes = _mm256_setr_epi8(0, 4, 8, 12, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, 0, 4, 8, 12,
                                             -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1);
  int i = 0;
  for (; i + 8 <= count; i += 8) {
    // Four bytes are read for two.
    const Eight e = Load(xy + 2 * i, fraction + i, raw.width, raw.height, stride, 3);
    if (!e.inside) {
      PlainPixels(raw, xy, fraction, i, i + 8, out);
      continue;
    }
    const __m256i p = _mm256_i32gather_epi32(reinterpret_cast<const int*>(raw.data), e.index, 1);
    const __m256i q = _mm256_i32gather_epi32(reinterpret_cast<const int*>(raw.data + stride), e.index, 1);
    // Weights of the first two bytes of each lane, the others have none.
    const __m256i wx = _mm256_or_si256(_mm256_sub_epi32(all, e.fx), _mm256_slli_epi32(e.fx, 8));
    const __m256i wy = _mm256_or_si256(_mm256_sub_epi32(all, e.fy), _mm256_slli_epi32(e.fy, 16));
    const __m256i top = _mm256_maddubs_epi16(p, wx), low = _mm256_maddubs_epi16(q, wx);
    const __m256i both = _mm256_or_si256(top, _mm256_slli_epi32(low, 16));
    const __m256i value = _mm256_srli_epi32(_mm256_add_epi32(_mm256_madd_epi16(both, wy), half), 10);
    const __m256i packed = _mm256_shuffle_epi8(value, low_bytes);
    const __m128i eight = _mm_unpacklo_epi32(_mm256_castsi256_si128(packed), _mm256_extracti128_si256(packed, 1));
    _mm_storel_epi64(reinterpret_cast<__m128i*>(out + i), eight);
  }
  PlainPixels(raw, xy, fraction, i, count, out);
}

void Floats(const RawImage<float>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int count, float* out) {
  const int stride = static_cast<int>(raw.stride);
  const __m256 unit = _mm256_set1_ps(1.0f / 32.0f);
  int i = 0;
  for (; i + 8 <= count; i += 8) {
    const Eight e = Load(xy + 2 * i, fraction + i, raw.width, raw.height, stride, 1);
    if (!e.inside) {
      PlainPixels(raw, xy, fraction, i, i + 8, out);
      continue;
    }
    const float* below = raw.data + stride;
    const __m256 p0 = _mm256_i32gather_ps(raw.data, e.index, 4), p1 = _mm256_i32gather_ps(raw.data + 1, e.index, 4);
    const __m256 q0 = _mm256_i32gather_ps(below, e.index, 4), q1 = _mm256_i32gather_ps(below + 1, e.index, 4);
    const __m256 ax = _mm256_mul_ps(unit, _mm256_cvtepi32_ps(e.fx)), ay = _mm256_mul_ps(unit, _mm256_cvtepi32_ps(e.fy));
    const __m256 top = _mm256_fmadd_ps(ax, _mm256_sub_ps(p1, p0), p0);
    const __m256 low = _mm256_fmadd_ps(ax, _mm256_sub_ps(q1, q0), q0);
    _mm256_storeu_ps(out + i, _mm256_fmadd_ps(ay, _mm256_sub_ps(low, top), top));
  }
  PlainPixels(raw, xy, fraction, i, count, out);
}

}  // namespace

const UndistortKernels internal::kUndistortAvx2 = {Bytes, Floats};

}  // namespace cairn::image
