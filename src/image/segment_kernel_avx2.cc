// Compiled for AVX2, but products are not fused with sums: the answer is that of every other processor. No templates of
// the standard library, see cpu_features.h.
#include <immintrin.h>

#include "image/segment_kernel.h"

namespace cairn::image::internal {
namespace {

// Per mask of four: which bytes come first.
struct Packing {
  alignas(16) std::uint8_t bytes[16][16];
};

constexpr Packing MakePacking() {
  Packing packing = {};
  for (int mask = 0; mask < 16; ++mask) {
    int to = 0;
    for (int from = 0; from < 4; ++from) {
      if ((mask >> from & 1) == 0) continue;
      for (int b = 0; b < 4; ++b) packing.bytes[mask][4 * to + b] = static_cast<std::uint8_t>(4 * from + b);
      ++to;
    }
  }
  return packing;
}

constexpr Packing kPacking = MakePacking();

}  // namespace

std::size_t NearSegmentAvx2(const GridEntry* entries, std::size_t count, const SegmentQuery& query,
                            std::uint32_t* out) {
  const __m256d begin_x = _mm256_set1_pd(query.begin_x), begin_y = _mm256_set1_pd(query.begin_y);
  const __m256d dx = _mm256_set1_pd(query.dx), dy = _mm256_set1_pd(query.dy);
  const __m256d inverse = _mm256_set1_pd(query.inverse_squared), limit = _mm256_set1_pd(query.half_width_squared);
  const __m256d zero = _mm256_setzero_pd(), one = _mm256_set1_pd(1.0);
  const __m128i low = _mm_set1_epi32(static_cast<int>(query.low_octave));
  const __m128i octaves = _mm_set1_epi32(static_cast<int>(query.octaves));
  std::size_t kept = 0, i = 0;
  for (; i + 4 <= count; i += 4) {
    __m128 x = _mm_loadu_ps(&entries[i].x_px), y = _mm_loadu_ps(&entries[i + 1].x_px);
    __m128 index = _mm_loadu_ps(&entries[i + 2].x_px), octave = _mm_loadu_ps(&entries[i + 3].x_px);
    _MM_TRANSPOSE4_PS(x, y, index, octave);
    const __m256d px = _mm256_sub_pd(_mm256_cvtps_pd(x), begin_x), py = _mm256_sub_pd(_mm256_cvtps_pd(y), begin_y);
    const __m256d dot = _mm256_add_pd(_mm256_mul_pd(px, dx), _mm256_mul_pd(py, dy));
    const __m256d along = _mm256_min_pd(_mm256_max_pd(_mm256_mul_pd(dot, inverse), zero), one);
    const __m256d ex = _mm256_sub_pd(px, _mm256_mul_pd(along, dx)), ey = _mm256_sub_pd(py, _mm256_mul_pd(along, dy));
    const __m256d squared = _mm256_add_pd(_mm256_mul_pd(ex, ex), _mm256_mul_pd(ey, ey));
    const int near = _mm256_movemask_pd(_mm256_cmp_pd(squared, limit, _CMP_LE_OQ));
    const __m128i above = _mm_sub_epi32(_mm_castps_si128(octave), low);
    const __m128i wanted = _mm_cmpeq_epi32(_mm_min_epu32(above, octaves), above);
    const int mask = near & _mm_movemask_ps(_mm_castsi128_ps(wanted));
    const __m128i shuffle = _mm_load_si128(reinterpret_cast<const __m128i*>(kPacking.bytes[mask]));
    _mm_storeu_si128(reinterpret_cast<__m128i*>(out + kept), _mm_shuffle_epi8(_mm_castps_si128(index), shuffle));
    kept += static_cast<std::size_t>(__builtin_popcount(static_cast<unsigned>(mask)));
  }
  return kept + NearSegmentPortable(entries + i, count - i, query, out + kept);
}

}  // namespace cairn::image::internal
