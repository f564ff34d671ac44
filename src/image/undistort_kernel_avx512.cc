#include <immintrin.h>

#include "image/undistort_kernel.h"
#include "image/undistort_kernel.inl"

namespace cairn::image {
namespace {

// Positions of sixteen pixels in the raw image.
struct Sixteen {
  __m512i index;  // elements
  __m512i fx, fy;
  bool inside;  // all of them with `reach` columns and one row behind
};

inline Sixteen Load(const std::int16_t* xy, const std::uint16_t* fraction, int width, int height, int stride,
                    int reach) {
  const __m512i pairs = _mm512_loadu_si512(xy);
  const __m512i x = _mm512_srai_epi32(_mm512_slli_epi32(pairs, 16), 16), y = _mm512_srai_epi32(pairs, 16);
  const __m512i f = _mm512_cvtepu16_epi32(_mm256_loadu_si256(reinterpret_cast<const __m256i*>(fraction)));
  // Compared as unsigned numbers, what is negative is too large.
  const __mmask16 x_inside = _mm512_cmple_epu32_mask(x, _mm512_set1_epi32(width - 1 - reach));
  const __mmask16 y_inside = _mm512_cmple_epu32_mask(y, _mm512_set1_epi32(height - 2));
  Sixteen s;
  s.index = _mm512_add_epi32(_mm512_mullo_epi32(y, _mm512_set1_epi32(stride)), x);
  s.fx = _mm512_and_si512(f, _mm512_set1_epi32(31));
  s.fy = _mm512_srli_epi32(f, 5);
  s.inside = width > reach && height > 1 && (x_inside & y_inside) == 0xFFFF;
  return s;
}

void Bytes(const RawImage<std::uint8_t>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int count,
           std::uint8_t* out) {
  const int stride = static_cast<int>(raw.stride);
  const __m512i all = _mm512_set1_epi32(32), half = _mm512_set1_epi32(512);
  int i = 0;
  for (; i + 16 <= count; i += 16) {
    // Four bytes are read for two.
    const Sixteen s = Load(xy + 2 * i, fraction + i, raw.width, raw.height, stride, 3);
    if (!s.inside) {
      PlainPixels(raw, xy, fraction, i, i + 16, out);
      continue;
    }
    const __m512i p = _mm512_i32gather_epi32(s.index, raw.data, 1);
    const __m512i q = _mm512_i32gather_epi32(s.index, raw.data + stride, 1);
    // Weights of the first two bytes of each lane, the others have none.
    const __m512i wx = _mm512_or_si512(_mm512_sub_epi32(all, s.fx), _mm512_slli_epi32(s.fx, 8));
    const __m512i wy = _mm512_or_si512(_mm512_sub_epi32(all, s.fy), _mm512_slli_epi32(s.fy, 16));
    const __m512i top = _mm512_maddubs_epi16(p, wx), low = _mm512_maddubs_epi16(q, wx);
    const __m512i both = _mm512_or_si512(top, _mm512_slli_epi32(low, 16));
    const __m512i value = _mm512_srli_epi32(_mm512_add_epi32(_mm512_madd_epi16(both, wy), half), 10);
    _mm_storeu_si128(reinterpret_cast<__m128i*>(out + i), _mm512_cvtepi32_epi8(value));
  }
  PlainPixels(raw, xy, fraction, i, count, out);
}

void Floats(const RawImage<float>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int count, float* out) {
  const int stride = static_cast<int>(raw.stride);
  const __m512 unit = _mm512_set1_ps(1.0f / 32.0f);
  int i = 0;
  for (; i + 16 <= count; i += 16) {
    const Sixteen s = Load(xy + 2 * i, fraction + i, raw.width, raw.height, stride, 1);
    if (!s.inside) {
      PlainPixels(raw, xy, fraction, i, i + 16, out);
      continue;
    }
    const float* below = raw.data + stride;
    const __m512 p0 = _mm512_i32gather_ps(s.index, raw.data, 4), p1 = _mm512_i32gather_ps(s.index, raw.data + 1, 4);
    const __m512 q0 = _mm512_i32gather_ps(s.index, below, 4), q1 = _mm512_i32gather_ps(s.index, below + 1, 4);
    const __m512 ax = _mm512_mul_ps(unit, _mm512_cvtepi32_ps(s.fx)), ay = _mm512_mul_ps(unit, _mm512_cvtepi32_ps(s.fy));
    const __m512 top = _mm512_fmadd_ps(ax, _mm512_sub_ps(p1, p0), p0);
    const __m512 low = _mm512_fmadd_ps(ax, _mm512_sub_ps(q1, q0), q0);
    _mm512_storeu_ps(out + i, _mm512_fmadd_ps(ay, _mm512_sub_ps(low, top), top));
  }
  PlainPixels(raw, xy, fraction, i, count, out);
}

}  // namespace

const UndistortKernels internal::kUndistortAvx512 = {Bytes, Floats};

}  // namespace cairn::image
