// The eight pixels of the pattern in the eight lanes of a register.
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

// Where the eight pixels are.
struct Places {
  __m256i index;  // of the channels of the upper left pixel
  __m256 ax, ay;  // from it
};

Places PlacesAt(__m256 x, __m256 y, int width) {
  const __m256i ix = _mm256_cvttps_epi32(x), iy = _mm256_cvttps_epi32(y);
  const __m256i pixel = _mm256_add_epi32(_mm256_mullo_epi32(iy, _mm256_set1_epi32(width)), ix);
  return {_mm256_slli_epi32(pixel, 2), _mm256_sub_ps(x, _mm256_cvtepi32_ps(ix)),
          _mm256_sub_ps(y, _mm256_cvtepi32_ps(iy))};
}

// Bilinear samples of the channel that `image` points to.
__m256 Sample(const float* image, int width, const Places& at) {
  const float* below = image + 4 * static_cast<long>(width);
  const __m256 p0 = _mm256_i32gather_ps(image, at.index, 4), p1 = _mm256_i32gather_ps(image + 4, at.index, 4);
  const __m256 q0 = _mm256_i32gather_ps(below, at.index, 4), q1 = _mm256_i32gather_ps(below + 4, at.index, 4);
  const __m256 top = _mm256_fmadd_ps(at.ax, _mm256_sub_ps(p1, p0), p0);
  const __m256 low = _mm256_fmadd_ps(at.ax, _mm256_sub_ps(q1, q0), q0);
  return _mm256_fmadd_ps(at.ay, _mm256_sub_ps(low, top), top);
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
    const Places at = PlacesAt(_mm256_add_ps(_mm256_set1_ps(x), dx), _mm256_add_ps(_mm256_set1_ps(y), dy), line.width);
    const __m256 magnitude = Magnitude(_mm256_sub_ps(Sample(line.image, line.width, at), expected));
    // Quadratic up to the threshold, linear beyond: c (2 |r| - c) with c = min(|r|, threshold).
    const __m256 c = _mm256_min_ps(magnitude, huber);
    energies[i] = SumOfLanes(_mm256_mul_ps(c, _mm256_sub_ps(_mm256_add_ps(magnitude, magnitude), c)));
  }
}

}  // namespace

void internal::TraceDerivativeAvx2(const TraceLine& line, float x, float y, TraceSums* sums) {
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

const TraceKernels internal::kTraceAvx2 = {Energies, internal::TraceDerivativeAvx2};

}  // namespace cairn::direct
