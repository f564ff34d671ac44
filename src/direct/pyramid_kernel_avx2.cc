#include <immintrin.h>

#include "direct/pyramid_kernel.h"

namespace cairn::direct {
namespace {

void HalveBytes(const unsigned char* top, const unsigned char* low, int width, float* out) {
  const __m256i ones = _mm256_set1_epi8(1);
  const __m256 quarter = _mm256_set1_ps(0.25f);
  int x = 0;
  for (; x + 16 <= width; x += 16) {
    const __m256i a = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(top + 2 * x));
    const __m256i b = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(low + 2 * x));
    const __m256i sum = _mm256_add_epi16(_mm256_maddubs_epi16(a, ones), _mm256_maddubs_epi16(b, ones));
    const __m256i first = _mm256_cvtepu16_epi32(_mm256_castsi256_si128(sum));
    const __m256i second = _mm256_cvtepu16_epi32(_mm256_extracti128_si256(sum, 1));
    _mm256_storeu_ps(out + x, _mm256_mul_ps(quarter, _mm256_cvtepi32_ps(first)));
    _mm256_storeu_ps(out + x + 8, _mm256_mul_ps(quarter, _mm256_cvtepi32_ps(second)));
  }
  for (; x < width; ++x) {
    out[x] = 0.25f * static_cast<float>(top[2 * x] + top[2 * x + 1] + low[2 * x] + low[2 * x + 1]);
  }
}

void HalveFloats(const float* top, const float* low, int width, float* out) {
  const __m256 quarter = _mm256_set1_ps(0.25f);
  int x = 0;
  for (; x + 8 <= width; x += 8) {
    const __m256 a = _mm256_add_ps(_mm256_loadu_ps(top + 2 * x), _mm256_loadu_ps(low + 2 * x));
    const __m256 b = _mm256_add_ps(_mm256_loadu_ps(top + 2 * x + 8), _mm256_loadu_ps(low + 2 * x + 8));
    // Pairs of neighbours, in the order 0 1 4 5 2 3 6 7.
    const __m256 pairs = _mm256_mul_ps(quarter, _mm256_hadd_ps(a, b));
    _mm256_storeu_ps(out + x, _mm256_castpd_ps(_mm256_permute4x64_pd(_mm256_castps_pd(pairs), 0xD8)));
  }
  for (; x < width; ++x) out[x] = 0.25f * ((top[2 * x] + low[2 * x]) + (top[2 * x + 1] + low[2 * x + 1]));
}

void ConvertBytes(const unsigned char* row, int width, float* out) {
  int x = 0;
  for (; x + 8 <= width; x += 8) {
    const __m128i bytes = _mm_loadl_epi64(reinterpret_cast<const __m128i*>(row + x));
    _mm256_storeu_ps(out + x, _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes)));
  }
  for (; x < width; ++x) out[x] = static_cast<float>(row[x]);
}

void OnePixel(const float* above, const float* row, const float* below, int x, float* out) {
  const float dx = 0.5f * (row[x + 1] - row[x - 1]), dy = 0.5f * (below[x] - above[x]);
  out[4 * x] = row[x];
  out[4 * x + 1] = dx;
  out[4 * x + 2] = dy;
  out[4 * x + 3] = dx * dx + dy * dy;
}

void BorderPixel(const float* row, int x, float* out) {
  out[4 * x] = row[x];
  out[4 * x + 1] = out[4 * x + 2] = out[4 * x + 3] = 0.0f;
}

void AddGradients(const float* above, const float* row, const float* below, int width, float* out) {
  const __m256 half = _mm256_set1_ps(0.5f);
  int x = 0;
  for (; x + 8 <= width; x += 8) {
    const __m256 gray = _mm256_loadu_ps(row + x);
    const __m256 dx = _mm256_mul_ps(half, _mm256_sub_ps(_mm256_loadu_ps(row + x + 1), _mm256_loadu_ps(row + x - 1)));
    const __m256 dy = _mm256_mul_ps(half, _mm256_sub_ps(_mm256_loadu_ps(below + x), _mm256_loadu_ps(above + x)));
    const __m256 square = _mm256_fmadd_ps(dx, dx, _mm256_mul_ps(dy, dy));
    // Four rows of eight to eight pixels of four: at first pixels k and k + 4 share a register.
    const __m256 low_a = _mm256_unpacklo_ps(gray, dx), high_a = _mm256_unpackhi_ps(gray, dx);
    const __m256 low_b = _mm256_unpacklo_ps(dy, square), high_b = _mm256_unpackhi_ps(dy, square);
    const __m256 p04 = _mm256_shuffle_ps(low_a, low_b, 0x44), p15 = _mm256_shuffle_ps(low_a, low_b, 0xEE);
    const __m256 p26 = _mm256_shuffle_ps(high_a, high_b, 0x44), p37 = _mm256_shuffle_ps(high_a, high_b, 0xEE);
    float* to = out + 4 * x;
    _mm256_storeu_ps(to, _mm256_permute2f128_ps(p04, p15, 0x20));
    _mm256_storeu_ps(to + 8, _mm256_permute2f128_ps(p26, p37, 0x20));
    _mm256_storeu_ps(to + 16, _mm256_permute2f128_ps(p04, p15, 0x31));
    _mm256_storeu_ps(to + 24, _mm256_permute2f128_ps(p26, p37, 0x31));
  }
  for (; x < width; ++x) OnePixel(above, row, below, x, out);
  BorderPixel(row, 0, out);
  BorderPixel(row, width - 1, out);
}

}  // namespace

const PyramidKernels internal::kPyramidAvx2 = {HalveBytes, HalveFloats, ConvertBytes, AddGradients};

}  // namespace cairn::direct
