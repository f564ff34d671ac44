#include <immintrin.h>

#include "direct/pyramid_kernel.h"

namespace cairn::direct {
namespace {

__mmask16 FirstLanes(int count) {
  return static_cast<__mmask16>(count >= 16 ? 0xFFFF : count <= 0 ? 0 : (1 << count) - 1);
}

void HalveBytes(const unsigned char* top, const unsigned char* low, int width, float* out) {
  const __m256i ones = _mm256_set1_epi8(1);
  const __m512 quarter = _mm512_set1_ps(0.25f);
  for (int x = 0; x < width; x += 16) {
    const __mmask16 lanes = FirstLanes(width - x);
    const __m256i a = _mm256_maskz_loadu_epi16(lanes, top + 2 * x), b = _mm256_maskz_loadu_epi16(lanes, low + 2 * x);
    const __m256i sum = _mm256_add_epi16(_mm256_maddubs_epi16(a, ones), _mm256_maddubs_epi16(b, ones));
    const __m512 gray = _mm512_cvtepi32_ps(_mm512_cvtepu16_epi32(sum));
    _mm512_mask_storeu_ps(out + x, lanes, _mm512_mul_ps(quarter, gray));
  }
}

void HalveFloats(const float* top, const float* low, int width, float* out) {
  const __m512i even = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20, 22, 24, 26, 28, 30);
  const __m512i odd = _mm512_setr_epi32(1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21, 23, 25, 27, 29, 31);
  const __m512 quarter = _mm512_set1_ps(0.25f);
  for (int x = 0; x < width; x += 16) {
    const __mmask16 lanes = FirstLanes(width - x);
    const int floats = 2 * (width - x);
    const __mmask16 first = FirstLanes(floats), second = FirstLanes(floats - 16);
    const __m512 a =
        _mm512_add_ps(_mm512_maskz_loadu_ps(first, top + 2 * x), _mm512_maskz_loadu_ps(first, low + 2 * x));
    const __m512 b =
        _mm512_add_ps(_mm512_maskz_loadu_ps(second, top + 2 * x + 16), _mm512_maskz_loadu_ps(second, low + 2 * x + 16));
    const __m512 sum = _mm512_add_ps(_mm512_permutex2var_ps(a, even, b), _mm512_permutex2var_ps(a, odd, b));
    _mm512_mask_storeu_ps(out + x, lanes, _mm512_mul_ps(quarter, sum));
  }
}

void ConvertBytes(const unsigned char* row, int width, float* out) {
  for (int x = 0; x < width; x += 16) {
    const __mmask16 lanes = FirstLanes(width - x);
    const __m128i bytes = _mm_maskz_loadu_epi8(lanes, row + x);
    _mm512_mask_storeu_ps(out + x, lanes, _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(bytes)));
  }
}

void AddGradients(const float* above, const float* row, const float* below, int width, float* out) {
  const __m512 half = _mm512_set1_ps(0.5f);
  for (int x = 0; x < width; x += 16) {
    const __m512 gray = _mm512_loadu_ps(row + x);
    const __m512 dx = _mm512_mul_ps(half, _mm512_sub_ps(_mm512_loadu_ps(row + x + 1), _mm512_loadu_ps(row + x - 1)));
    const __m512 dy = _mm512_mul_ps(half, _mm512_sub_ps(_mm512_loadu_ps(below + x), _mm512_loadu_ps(above + x)));
    const __m512 square = _mm512_fmadd_ps(dx, dx, _mm512_mul_ps(dy, dy));
    // Four rows of sixteen to sixteen pixels of four: at first pixels k, k + 4, k + 8 and k + 12 share a register.
    const __m512 low_a = _mm512_unpacklo_ps(gray, dx), high_a = _mm512_unpackhi_ps(gray, dx);
    const __m512 low_b = _mm512_unpacklo_ps(dy, square), high_b = _mm512_unpackhi_ps(dy, square);
    const __m512 p0 = _mm512_shuffle_ps(low_a, low_b, 0x44), p1 = _mm512_shuffle_ps(low_a, low_b, 0xEE);
    const __m512 p2 = _mm512_shuffle_ps(high_a, high_b, 0x44), p3 = _mm512_shuffle_ps(high_a, high_b, 0xEE);
    const __m512 first_a = _mm512_shuffle_f32x4(p0, p1, 0x44), first_b = _mm512_shuffle_f32x4(p2, p3, 0x44);
    const __m512 last_a = _mm512_shuffle_f32x4(p0, p1, 0xEE), last_b = _mm512_shuffle_f32x4(p2, p3, 0xEE);
    float* to = out + 4 * x;
    const int rest = 4 * (width - x);
    _mm512_mask_storeu_ps(to, FirstLanes(rest), _mm512_shuffle_f32x4(first_a, first_b, 0x88));
    _mm512_mask_storeu_ps(to + 16, FirstLanes(rest - 16), _mm512_shuffle_f32x4(first_a, first_b, 0xDD));
    _mm512_mask_storeu_ps(to + 32, FirstLanes(rest - 32), _mm512_shuffle_f32x4(last_a, last_b, 0x88));
    _mm512_mask_storeu_ps(to + 48, FirstLanes(rest - 48), _mm512_shuffle_f32x4(last_a, last_b, 0xDD));
  }
  float* last = out + 4 * (width - 1);
  out[1] = out[2] = out[3] = last[1] = last[2] = last[3] = 0.0f;
}

}  // namespace

const PyramidKernels internal::kPyramidAvx512 = {HalveBytes, HalveFloats, ConvertBytes, AddGradients};

}  // namespace cairn::direct
