// Eight floats at a time with the compiler's vector extension: the same source becomes two SSE registers in a baseline
// file and one AVX register in a *_avx2.cc file. Only to be used inside functions with internal linkage, so that no
// object file lends its code to a machine without the instructions.
#pragma once

#include <cstring>

#ifdef __AVX2__
#include <immintrin.h>
#endif

namespace cairn::direct {

using V4 = float __attribute__((vector_size(16)));
using V8 = float __attribute__((vector_size(32)));
using V8i = int __attribute__((vector_size(32)));

// Internal linkage on purpose, see above. Vectors go by reference: passed by value their ABI depends on the target.
namespace {

[[maybe_unused]] inline void Load(const float* p, V4* v) { std::memcpy(v, p, sizeof(*v)); }
[[maybe_unused]] inline void Load(const float* p, V8* v) { std::memcpy(v, p, sizeof(*v)); }

// The sums of the lanes of four vectors.
[[maybe_unused]] inline void SumOfFour(const V8& a, const V8& b, const V8& c, const V8& d, float* sums) {
  const V8 ab = __builtin_shufflevector(a, b, 0, 8, 1, 9, 4, 12, 5, 13) +
                __builtin_shufflevector(a, b, 2, 10, 3, 11, 6, 14, 7, 15);
  const V8 cd = __builtin_shufflevector(c, d, 0, 8, 1, 9, 4, 12, 5, 13) +
                __builtin_shufflevector(c, d, 2, 10, 3, 11, 6, 14, 7, 15);
  const V8 all = __builtin_shufflevector(ab, cd, 0, 1, 8, 9, 4, 5, 12, 13) +
                 __builtin_shufflevector(ab, cd, 2, 3, 10, 11, 6, 7, 14, 15);
  const V4 result = __builtin_shufflevector(all, all, 0, 1, 2, 3) + __builtin_shufflevector(all, all, 4, 5, 6, 7);
  std::memcpy(sums, &result, sizeof(result));
}

// Whether a comparison holds in any lane.
[[maybe_unused]] inline bool AnyLane(const V8i& v) {
#ifdef __AVX2__
  return _mm256_movemask_epi8(reinterpret_cast<__m256i>(v)) != 0;
#else
  int any = 0;
  for (int k = 0; k < 8; ++k) any |= v[k];
  return any != 0;
#endif
}

#ifdef __AVX2__

// The same pixel of lanes k and k + 4.
[[maybe_unused]] inline __m256 LoadTwo(const float* a, const float* b) {
  return _mm256_insertf128_ps(_mm256_castps128_ps256(_mm_loadu_ps(a)), _mm_loadu_ps(b), 1);
}

template <int k>
[[maybe_unused]] inline __m256 SampleTwo(const float* a, const float* b, long row, __m256 ax, __m256 ay) {
  const __m256 p0 = LoadTwo(a, b), p1 = LoadTwo(a + 4, b + 4);
  const __m256 q0 = LoadTwo(a + row, b + row), q1 = LoadTwo(a + row + 4, b + row + 4);
  const __m256 x = _mm256_permute_ps(ax, 0x55 * k), y = _mm256_permute_ps(ay, 0x55 * k);
  const __m256 top = _mm256_fmadd_ps(x, _mm256_sub_ps(p1, p0), p0);
  const __m256 low = _mm256_fmadd_ps(x, _mm256_sub_ps(q1, q0), q0);
  return _mm256_fmadd_ps(y, _mm256_sub_ps(low, top), top);
}

// Bilinear samples of {value, dx, dy, -} at eight positions inside an image in ImagePyramid layout.
[[maybe_unused]] inline void SampleEight(const float* image, int width, const V8& x, const V8& y, V8* value, V8* dx,
                                         V8* dy) {
  const __m256i ix = _mm256_cvttps_epi32(x), iy = _mm256_cvttps_epi32(y);
  const __m256 ax = _mm256_sub_ps(x, _mm256_cvtepi32_ps(ix)), ay = _mm256_sub_ps(y, _mm256_cvtepi32_ps(iy));
  const long row = 4 * static_cast<long>(width);
  alignas(32) int at[8];
  const __m256i pixel = _mm256_add_epi32(_mm256_mullo_epi32(iy, _mm256_set1_epi32(width)), ix);
  _mm256_store_si256(reinterpret_cast<__m256i*>(at), _mm256_slli_epi32(pixel, 2));
  const __m256 s0 = SampleTwo<0>(image + at[0], image + at[4], row, ax, ay);
  const __m256 s1 = SampleTwo<1>(image + at[1], image + at[5], row, ax, ay);
  const __m256 s2 = SampleTwo<2>(image + at[2], image + at[6], row, ax, ay);
  const __m256 s3 = SampleTwo<3>(image + at[3], image + at[7], row, ax, ay);
  const __m256 a = _mm256_unpacklo_ps(s0, s1), b = _mm256_unpacklo_ps(s2, s3);
  *value = _mm256_shuffle_ps(a, b, 0x44);
  *dx = _mm256_shuffle_ps(a, b, 0xEE);
  *dy = _mm256_shuffle_ps(_mm256_unpackhi_ps(s0, s1), _mm256_unpackhi_ps(s2, s3), 0x44);
}

#else

// Bilinear samples of {value, dx, dy, -} at eight positions inside an image in ImagePyramid layout.
[[maybe_unused]] inline void SampleEight(const float* image, int width, const V8& x, const V8& y, V8* value, V8* dx,
                                         V8* dy) {
  const V8i ix = __builtin_convertvector(x, V8i), iy = __builtin_convertvector(y, V8i);
  const V8 ax = x - __builtin_convertvector(ix, V8), ay = y - __builtin_convertvector(iy, V8);
  const V8i at = (iy * width + ix) * 4;
  const long row = 4 * static_cast<long>(width);
  V4 s[8];
  for (int k = 0; k < 8; ++k) {
    const float* p = image + at[k];
    V4 p0, p1, q0, q1;
    Load(p, &p0), Load(p + 4, &p1), Load(p + row, &q0), Load(p + row + 4, &q1);
    const V4 top = p0 + ax[k] * (p1 - p0), low = q0 + ax[k] * (q1 - q0);
    s[k] = top + ay[k] * (low - top);
  }
  // Transposition of 8 x 4.
  const V8 s04 = __builtin_shufflevector(s[0], s[4], 0, 1, 2, 3, 4, 5, 6, 7),
           s15 = __builtin_shufflevector(s[1], s[5], 0, 1, 2, 3, 4, 5, 6, 7);
  const V8 s26 = __builtin_shufflevector(s[2], s[6], 0, 1, 2, 3, 4, 5, 6, 7),
           s37 = __builtin_shufflevector(s[3], s[7], 0, 1, 2, 3, 4, 5, 6, 7);
  const V8 low01 = __builtin_shufflevector(s04, s15, 0, 8, 1, 9, 4, 12, 5, 13),
           low23 = __builtin_shufflevector(s26, s37, 0, 8, 1, 9, 4, 12, 5, 13);
  const V8 high01 = __builtin_shufflevector(s04, s15, 2, 10, 3, 11, 6, 14, 7, 15),
           high23 = __builtin_shufflevector(s26, s37, 2, 10, 3, 11, 6, 14, 7, 15);
  *value = __builtin_shufflevector(low01, low23, 0, 1, 8, 9, 4, 5, 12, 13);
  *dx = __builtin_shufflevector(low01, low23, 2, 3, 10, 11, 6, 7, 14, 15);
  *dy = __builtin_shufflevector(high01, high23, 0, 1, 8, 9, 4, 5, 12, 13);
}

#endif

}  // namespace

}  // namespace cairn::direct
