// The eight pixels of the pattern in the eight lanes of a register. (Two places in the sixteen lanes of AVX-512 are no
// faster: loading the pixels takes the time.)
#include <immintrin.h>

#include "direct/lanes.h"
#include "direct/trace_kernel.h"

namespace cairn::direct {
namespace {

float SumOfLanes(__m256 v) {
  __m128 sum = _mm_add_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps(v, 1));
  sum = _mm_add_ps(sum, _mm_movehl_ps(sum, sum));
  return _mm_cvtss_f32(_mm_add_ss(sum, _mm_movehdup_ps(sum)));
}

// The intensities of four pixels, and in the upper half those to the right of them. One load has both, four floats
// apart; loads that begin a few floats earlier put them where a blend can collect them.
__m256 FourPairs(const float* row, const int* index) {
  const __m256 a = _mm256_loadu_ps(row + index[0]), b = _mm256_loadu_ps(row + index[1] - 1);
  const __m256 c = _mm256_loadu_ps(row + index[2] - 2), d = _mm256_loadu_ps(row + index[3] - 3);
  return _mm256_blend_ps(_mm256_blend_ps(a, b, 0x22), _mm256_blend_ps(c, d, 0x88), 0xCC);
}

// Bilinear samples of the intensity; the places are at least a pixel inside the image. Gathers need half as many lines,
// and twice the time on processors that split them up.
__m256 Sample(const float* image, int width, __m256 x, __m256 y) {
  const __m256i ix = _mm256_cvttps_epi32(x), iy = _mm256_cvttps_epi32(y);
  const __m256 ax = _mm256_sub_ps(x, _mm256_cvtepi32_ps(ix)), ay = _mm256_sub_ps(y, _mm256_cvtepi32_ps(iy));
  alignas(32) int at[8];  // the channels of the upper left pixels
  const __m256i pixel = _mm256_add_epi32(_mm256_mullo_epi32(iy, _mm256_set1_epi32(width)), ix);
  _mm256_store_si256(reinterpret_cast<__m256i*>(at), _mm256_slli_epi32(pixel, 2));
  const float* below = image + 4 * static_cast<long>(width);
  const __m256 p_low = FourPairs(image, at), p_high = FourPairs(image, at + 4);
  const __m256 q_low = FourPairs(below, at), q_high = FourPairs(below, at + 4);
  const __m256 p0 = _mm256_permute2f128_ps(p_low, p_high, 0x20), p1 = _mm256_permute2f128_ps(p_low, p_high, 0x31);
  const __m256 q0 = _mm256_permute2f128_ps(q_low, q_high, 0x20), q1 = _mm256_permute2f128_ps(q_low, q_high, 0x31);
  const __m256 top = _mm256_fmadd_ps(ax, _mm256_sub_ps(p1, p0), p0);
  const __m256 low = _mm256_fmadd_ps(ax, _mm256_sub_ps(q1, q0), q0);
  return _mm256_fmadd_ps(ay, _mm256_sub_ps(low, top), top);
}

__m256 Magnitude(__m256 v) { return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), v); }

void Energies(const TraceLine& line, float first, float step, int count, float* energies) {
  const __m256 dx = _mm256_loadu_ps(line.pattern->dx), dy = _mm256_loadu_ps(line.pattern->dy);
  const __m256 expected = _mm256_loadu_ps(line.pattern->expected), huber = _mm256_set1_ps(line.huber);
  const float right = static_cast<float>(line.width) - line.border - 1.0f;
  const float bottom = static_cast<float>(line.height) - line.border - 1.0f;
  for (int i = 0; i < count; ++i) {
    const float t = first + static_cast<float>(i) * step;
    const float x = line.x + t * line.dx, y = line.y + t * line.dy;
    energies[i] = kOutsideEnergy;
    if (!(x > line.border && y > line.border && x < right && y < bottom)) continue;
    const __m256 px = _mm256_add_ps(_mm256_set1_ps(x), dx), py = _mm256_add_ps(_mm256_set1_ps(y), dy);
    const __m256 magnitude = Magnitude(_mm256_sub_ps(Sample(line.image, line.width, px, py), expected));
    // Quadratic up to the threshold, linear beyond: c (2 |r| - c) with c = min(|r|, threshold).
    const __m256 c = _mm256_min_ps(magnitude, huber);
    energies[i] = SumOfLanes(_mm256_mul_ps(c, _mm256_sub_ps(_mm256_add_ps(magnitude, magnitude), c)));
  }
}

void Derivative(const TraceLine& line, float x, float y, TraceSums* sums) {
  const __m256 px = _mm256_add_ps(_mm256_set1_ps(x), _mm256_loadu_ps(line.pattern->dx));
  const __m256 py = _mm256_add_ps(_mm256_set1_ps(y), _mm256_loadu_ps(line.pattern->dy));
  V8 value, gx, gy;
  SampleEight(line.image, line.width, px, py, &value, &gx, &gy);
  const __m256 r = _mm256_sub_ps(value, _mm256_loadu_ps(line.pattern->expected));
  const __m256 j = _mm256_fmadd_ps(_mm256_set1_ps(line.dx), gx, _mm256_mul_ps(_mm256_set1_ps(line.dy), gy));
  const __m256 magnitude = Magnitude(r), huber = _mm256_set1_ps(line.huber);
  const __m256 w = _mm256_div_ps(huber, _mm256_max_ps(magnitude, huber));
  const __m256 wj = _mm256_mul_ps(w, j);
  sums->h = SumOfLanes(_mm256_mul_ps(wj, j));
  sums->b = SumOfLanes(_mm256_mul_ps(wj, r));
  const __m256 c = _mm256_min_ps(magnitude, huber);
  sums->energy = SumOfLanes(_mm256_mul_ps(c, _mm256_sub_ps(_mm256_add_ps(magnitude, magnitude), c)));
}

}  // namespace

const TraceKernels internal::kTraceAvx2 = {Energies, Derivative};

}  // namespace cairn::direct
