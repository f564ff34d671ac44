// Eight floats at a time with the compiler's vector extension: the same source becomes two SSE registers in a baseline
// file and one AVX register in a *_avx2.cc file. Only to be used inside functions with internal linkage, so that no
// object file lends its code to a machine without the instructions.
#pragma once

#include <cstring>

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

}  // namespace

}  // namespace cairn::direct
