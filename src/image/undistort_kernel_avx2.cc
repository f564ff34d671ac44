// Where eight pixels come from one row of the raw image, not far from each other, as most do, a few whole loads hold
// all of them, and permutations pick them out. Elsewhere every pixel is loaded by itself: bytes by a gather, floats in
// pairs, as a gather of them takes twice the time on an AMD EPYC.
#include <immintrin.h>

#include "image/undistort_kernel.h"
#include "image/undistort_kernel.inl"

namespace cairn::image {
namespace {

// How far in 32nds of a pixel.
struct Fractions {
  __m256i x, y;
};

inline Fractions LoadFractions(const std::uint16_t* fraction) {
  const __m256i f = _mm256_cvtepu16_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(fraction)));
  return {_mm256_and_si256(f, _mm256_set1_epi32(31)), _mm256_srli_epi32(f, 5)};
}

constexpr int kSpan = 14;  // pixels from the first, at most, and one more is read

// True if eight pixels begin in one row, `offset` (0 to kSpan) behind the first, and kSpan + 3 pixels of this row and
// of the next can be read from there.
inline bool InOneRow(const std::int16_t* xy, int width, int height, __m256i* offset) {
  const __m256i pairs = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(xy));
  // A row or a column before the first makes a large number, too.
  *offset = _mm256_sub_epi16(pairs, _mm256_broadcastd_epi32(_mm256_castsi256_si128(pairs)));
  const __m256i near = _mm256_cmpeq_epi32(_mm256_min_epu32(*offset, _mm256_set1_epi32(kSpan)), *offset);
  return xy[0] >= 0 && xy[0] + kSpan + 3 <= width && xy[1] >= 0 && xy[1] + 1 < height &&
         _mm256_movemask_epi8(near) == -1;
}

// True if all of eight pixels have `reach` columns and one row behind them; `index` in elements.
inline bool Inside(const std::int16_t* xy, int width, int height, int stride, int reach, __m256i* index) {
  const __m256i pairs = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(xy));
  const __m256i x = _mm256_srai_epi32(_mm256_slli_epi32(pairs, 16), 16), y = _mm256_srai_epi32(pairs, 16);
  // Compared as unsigned numbers, what is negative is too large.
  const __m256i x_last = _mm256_set1_epi32(width - 1 - reach), y_last = _mm256_set1_epi32(height - 2);
  const __m256i inside = _mm256_and_si256(_mm256_cmpeq_epi32(_mm256_min_epu32(x, x_last), x),
                                          _mm256_cmpeq_epi32(_mm256_min_epu32(y, y_last), y));
  *index = _mm256_add_epi32(_mm256_mullo_epi32(y, _mm256_set1_epi32(stride)), x);
  return width > reach && height > 1 && _mm256_movemask_epi8(inside) == -1;
}

// Sixteen bytes, the same in both halves.
inline __m256i LoadBytes(const std::uint8_t* p) {
  return _mm256_broadcastsi128_si256(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p)));
}

// `p` and `q`: two bytes of the upper and of the lower row in each lane; those behind them do not matter.
inline void BlendBytes(__m256i p, __m256i q, const Fractions& f, std::uint8_t* out) {
  const __m256i all = _mm256_set1_epi32(32), half = _mm256_set1_epi32(512);
  const __m256i low_bytes = _mm256_setr_epi8(0, 4, 8, 12, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1,  //
                                             0, 4, 8, 12, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1, -1);
  // Weights of the first two bytes of each lane, the others have none.
  const __m256i wx = _mm256_or_si256(_mm256_sub_epi32(all, f.x), _mm256_slli_epi32(f.x, 8));
  const __m256i wy = _mm256_or_si256(_mm256_sub_epi32(all, f.y), _mm256_slli_epi32(f.y, 16));
  const __m256i top = _mm256_maddubs_epi16(p, wx), low = _mm256_maddubs_epi16(q, wx);
  const __m256i both = _mm256_or_si256(top, _mm256_slli_epi32(low, 16));
  const __m256i value = _mm256_srli_epi32(_mm256_add_epi32(_mm256_madd_epi16(both, wy), half), 10);
  const __m256i packed = _mm256_shuffle_epi8(value, low_bytes);
  const __m128i eight = _mm_unpacklo_epi32(_mm256_castsi256_si128(packed), _mm256_extracti128_si256(packed, 1));
  _mm_storel_epi64(reinterpret_cast<__m128i*>(out), eight);
}

void Bytes(const RawImage<std::uint8_t>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int count,
           std::uint8_t* out) {
  const int stride = static_cast<int>(raw.stride);
  int i = 0;
  for (; i + 8 <= count; i += 8) {
    __m256i at;
    if (InOneRow(xy + 2 * i, raw.width, raw.height, &at)) {
      const std::uint8_t* first = raw.data + xy[2 * i + 1] * raw.stride + xy[2 * i];
      // The byte there and the one behind it.
      const __m256i two = _mm256_add_epi32(_mm256_or_si256(at, _mm256_slli_epi32(at, 8)), _mm256_set1_epi32(0x0100));
      BlendBytes(_mm256_shuffle_epi8(LoadBytes(first), two), _mm256_shuffle_epi8(LoadBytes(first + raw.stride), two),
                 LoadFractions(fraction + i), out + i);
    } else if (Inside(xy + 2 * i, raw.width, raw.height, stride, 3, &at)) {
      // Four bytes are read for two.
      const int* data = reinterpret_cast<const int*>(raw.data);
      const int* below = reinterpret_cast<const int*>(raw.data + stride);
      BlendBytes(_mm256_i32gather_epi32(data, at, 1), _mm256_i32gather_epi32(below, at, 1), LoadFractions(fraction + i),
                 out + i);
    } else {
      PlainPixels(raw, xy, fraction, i, i + 8, out);
    }
  }
  PlainPixels(raw, xy, fraction, i, count, out);
}

// Of sixteen floats those at the offsets `at`.
inline __m256 Pick(const float* p, __m256i at) {
  const __m256 first = _mm256_permutevar8x32_ps(_mm256_loadu_ps(p), at);
  const __m256 second = _mm256_permutevar8x32_ps(_mm256_loadu_ps(p + 8), at);
  return _mm256_blendv_ps(first, second, _mm256_castsi256_ps(_mm256_slli_epi32(at, 28)));
}

inline void BlendFloats(__m256 p0, __m256 p1, __m256 q0, __m256 q1, const Fractions& f, float* out) {
  const __m256 unit = _mm256_set1_ps(1.0f / 32.0f);
  const __m256 ax = _mm256_mul_ps(unit, _mm256_cvtepi32_ps(f.x)), ay = _mm256_mul_ps(unit, _mm256_cvtepi32_ps(f.y));
  const __m256 top = _mm256_fmadd_ps(ax, _mm256_sub_ps(p1, p0), p0);
  const __m256 low = _mm256_fmadd_ps(ax, _mm256_sub_ps(q1, q0), q0);
  _mm256_storeu_ps(out, _mm256_fmadd_ps(ay, _mm256_sub_ps(low, top), top));
}

// Four floats: two at `a` and two at `b`.
inline __m128 TwoPairs(const float* a, const float* b) {
  const __m128d low = _mm_load_sd(reinterpret_cast<const double*>(a));
  return _mm_castpd_ps(_mm_loadh_pd(low, reinterpret_cast<const double*>(b)));
}

// The floats at eight places and those behind them.
inline void PickAnywhere(const float* p, const int* at, __m256* here, __m256* behind) {
  const __m256 a = _mm256_set_m128(TwoPairs(p + at[4], p + at[5]), TwoPairs(p + at[0], p + at[1]));
  const __m256 b = _mm256_set_m128(TwoPairs(p + at[6], p + at[7]), TwoPairs(p + at[2], p + at[3]));
  *here = _mm256_shuffle_ps(a, b, 0x88), *behind = _mm256_shuffle_ps(a, b, 0xDD);
}

void Floats(const RawImage<float>& raw, const std::int16_t* xy, const std::uint16_t* fraction, int count, float* out) {
  const int stride = static_cast<int>(raw.stride);
  int i = 0;
  for (; i + 8 <= count; i += 8) {
    __m256i at;
    if (InOneRow(xy + 2 * i, raw.width, raw.height, &at)) {
      const float *p = raw.data + xy[2 * i + 1] * raw.stride + xy[2 * i], *q = p + raw.stride;
      BlendFloats(Pick(p, at), Pick(p + 1, at), Pick(q, at), Pick(q + 1, at), LoadFractions(fraction + i), out + i);
    } else if (Inside(xy + 2 * i, raw.width, raw.height, stride, 1, &at)) {
      alignas(32) int index[8];
      _mm256_store_si256(reinterpret_cast<__m256i*>(index), at);
      __m256 p0, p1, q0, q1;
      PickAnywhere(raw.data, index, &p0, &p1);
      PickAnywhere(raw.data + stride, index, &q0, &q1);
      BlendFloats(p0, p1, q0, q1, LoadFractions(fraction + i), out + i);
    } else {
      PlainPixels(raw, xy, fraction, i, i + 8, out);
    }
  }
  PlainPixels(raw, xy, fraction, i, count, out);
}

}  // namespace

const UndistortKernels internal::kUndistortAvx2 = {Bytes, Floats};

}  // namespace cairn::image
