// The eight pixels of the pattern at two places in the sixteen lanes of a register.
#include <immintrin.h>

#include "direct/trace_kernel.h"

namespace cairn::direct {
namespace {

__m512 Twice(const float* eight) {
  const __m256 half = _mm256_loadu_ps(eight);
  return _mm512_insertf32x8(_mm512_castps256_ps512(half), half, 1);
}

__m512 Halves(float low, float high) { return _mm512_insertf32x8(_mm512_set1_ps(low), _mm256_set1_ps(high), 1); }

__m512 Gather(const float* from, __m512i index, __mmask16 lanes) {
  return _mm512_mask_i32gather_ps(_mm512_setzero_ps(), lanes, index, from, 4);
}

float SumOfLanes(__m256 v) {
  __m128 sum = _mm_add_ps(_mm256_castps256_ps128(v), _mm256_extractf128_ps(v, 1));
  sum = _mm_add_ps(sum, _mm_movehl_ps(sum, sum));
  return _mm_cvtss_f32(_mm_add_ss(sum, _mm_movehdup_ps(sum)));
}

void Energies(const TraceLine& line, float first, float step, int count, float* energies) {
  const __m512 dx = Twice(line.pattern->dx), dy = Twice(line.pattern->dy);
  const __m512 expected = Twice(line.pattern->expected), huber = _mm512_set1_ps(line.huber);
  const float right = static_cast<float>(line.width) - line.border - 1.0f;
  const float bottom = static_cast<float>(line.height) - line.border - 1.0f;
  const float* below = line.image + 4 * static_cast<long>(line.width);
  for (int i = 0; i < count; i += 2) {
    const float t[2] = {first + static_cast<float>(i) * step, first + static_cast<float>(i + 1) * step};
    float x[2], y[2];
    bool inside[2];
    for (int k = 0; k < 2; ++k) {
      x[k] = line.x + t[k] * line.dx, y[k] = line.y + t[k] * line.dy;
      inside[k] = i + k < count && x[k] > line.border && y[k] > line.border && x[k] < right && y[k] < bottom;
    }
    const __mmask16 lanes = static_cast<__mmask16>((inside[0] ? 0x00FF : 0) | (inside[1] ? 0xFF00 : 0));
    const __m512 px = _mm512_add_ps(Halves(x[0], x[1]), dx), py = _mm512_add_ps(Halves(y[0], y[1]), dy);
    const __m512i ix = _mm512_cvttps_epi32(px), iy = _mm512_cvttps_epi32(py);
    const __m512 ax = _mm512_sub_ps(px, _mm512_cvtepi32_ps(ix)), ay = _mm512_sub_ps(py, _mm512_cvtepi32_ps(iy));
    const __m512i pixel = _mm512_add_epi32(_mm512_mullo_epi32(iy, _mm512_set1_epi32(line.width)), ix);
    const __m512i index = _mm512_slli_epi32(pixel, 2);
    const __m512 p0 = Gather(line.image, index, lanes), p1 = Gather(line.image + 4, index, lanes);
    const __m512 q0 = Gather(below, index, lanes), q1 = Gather(below + 4, index, lanes);
    const __m512 top = _mm512_fmadd_ps(ax, _mm512_sub_ps(p1, p0), p0);
    const __m512 low = _mm512_fmadd_ps(ax, _mm512_sub_ps(q1, q0), q0);
    const __m512 value = _mm512_fmadd_ps(ay, _mm512_sub_ps(low, top), top);
    const __m512 magnitude = _mm512_abs_ps(_mm512_sub_ps(value, expected));
    // Quadratic up to the threshold, linear beyond: c (2 |r| - c) with c = min(|r|, threshold).
    const __m512 c = _mm512_min_ps(magnitude, huber);
    const __m512 energy = _mm512_mul_ps(c, _mm512_sub_ps(_mm512_add_ps(magnitude, magnitude), c));
    energies[i] = inside[0] ? SumOfLanes(_mm512_castps512_ps256(energy)) : kOutsideEnergy;
    if (i + 1 < count) energies[i + 1] = inside[1] ? SumOfLanes(_mm512_extractf32x8_ps(energy, 1)) : kOutsideEnergy;
  }
}

}  // namespace

const TraceKernels internal::kTraceAvx512 = {Energies, internal::TraceDerivativeAvx2};

}  // namespace cairn::direct
