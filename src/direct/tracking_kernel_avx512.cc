// Sixteen points at a time. The same steps as tracking_kernel.inl.
#include <immintrin.h>

#include "direct/tracking_kernel.h"

namespace cairn::direct {
namespace {

constexpr int kColumns = kTrackingUnknowns + 1;               // Jacobian and residual
constexpr int kProducts = kColumns * (kColumns + 1) / 2 - 1;  // all but residual times residual

__m512 All(float value) { return _mm512_set1_ps(value); }

// The same pixel of lanes k, k + 4, k + 8 and k + 12.
inline __m512 LoadFour(const float* image, const int* at, int k, long offset) {
  __m512 v = _mm512_castps128_ps512(_mm_loadu_ps(image + at[k] + offset));
  v = _mm512_insertf32x4(v, _mm_loadu_ps(image + at[k + 4] + offset), 1);
  v = _mm512_insertf32x4(v, _mm_loadu_ps(image + at[k + 8] + offset), 2);
  return _mm512_insertf32x4(v, _mm_loadu_ps(image + at[k + 12] + offset), 3);
}

template <int k>
__m512 SampleFour(const float* image, const int* at, long row, __m512 ax, __m512 ay) {
  const __m512 p0 = LoadFour(image, at, k, 0), p1 = LoadFour(image, at, k, 4);
  const __m512 q0 = LoadFour(image, at, k, row), q1 = LoadFour(image, at, k, row + 4);
  const __m512 x = _mm512_permute_ps(ax, 0x55 * k), y = _mm512_permute_ps(ay, 0x55 * k);
  const __m512 top = _mm512_fmadd_ps(x, _mm512_sub_ps(p1, p0), p0);
  const __m512 low = _mm512_fmadd_ps(x, _mm512_sub_ps(q1, q0), q0);
  return _mm512_fmadd_ps(y, _mm512_sub_ps(low, top), top);
}

// Bilinear samples of {value, dx, dy, -} at sixteen positions inside an image in ImagePyramid layout.
void SampleSixteen(const float* image, int width, __m512 x, __m512 y, __m512* value, __m512* dx, __m512* dy) {
  const __m512i ix = _mm512_cvttps_epi32(x), iy = _mm512_cvttps_epi32(y);
  const __m512 ax = _mm512_sub_ps(x, _mm512_cvtepi32_ps(ix)), ay = _mm512_sub_ps(y, _mm512_cvtepi32_ps(iy));
  alignas(64) int at[16];
  const __m512i pixel = _mm512_add_epi32(_mm512_mullo_epi32(iy, _mm512_set1_epi32(width)), ix);
  _mm512_store_si512(at, _mm512_slli_epi32(pixel, 2));
  const long row = 4 * static_cast<long>(width);
  const __m512 s0 = SampleFour<0>(image, at, row, ax, ay), s1 = SampleFour<1>(image, at, row, ax, ay);
  const __m512 s2 = SampleFour<2>(image, at, row, ax, ay), s3 = SampleFour<3>(image, at, row, ax, ay);
  const __m512 a = _mm512_unpacklo_ps(s0, s1), b = _mm512_unpacklo_ps(s2, s3);
  *value = _mm512_shuffle_ps(a, b, 0x44);
  *dx = _mm512_shuffle_ps(a, b, 0xEE);
  *dy = _mm512_shuffle_ps(_mm512_unpackhi_ps(s0, s1), _mm512_unpackhi_ps(s2, s3), 0x44);
}

}  // namespace

void TrackingKernelAvx512(const TrackingKernelInput& in, TrackingKernelSums* sums) {
  __m512 products[kProducts];
  for (__m512& product : products) product = _mm512_setzero_ps();
  __m512 energy = _mm512_setzero_ps();
  const float* r = in.rotation_rays;
  const __m512 one = All(1.0f), two = All(2.0f);
  const __m512 x_limit = All(static_cast<float>(in.width - 3)), y_limit = All(static_cast<float>(in.height - 3));
  const __m512 saturated_energy = All(in.huber * (2.0f * in.cutoff - in.huber));
  sums->visible = sums->saturated = 0;
  for (int i = 0; i < in.count; i += 16) {
    const __mmask16 lanes = in.count - i >= 16 ? 0xFFFF : 0x00FF;
    const __m512 x = _mm512_maskz_loadu_ps(lanes, in.x + i), y = _mm512_maskz_loadu_ps(lanes, in.y + i);
    const __m512 id = _mm512_maskz_loadu_ps(lanes, in.inverse_depth + i);
    const __m512 color = _mm512_maskz_loadu_ps(lanes, in.color + i);
    __m512 p[3];
    for (int k = 0; k < 3; ++k) {
      const __m512 shift = _mm512_fmadd_ps(All(in.translation[k]), id, All(r[3 * k + 2]));
      p[k] = _mm512_fmadd_ps(All(r[3 * k]), x, _mm512_fmadd_ps(All(r[3 * k + 1]), y, shift));
    }
    const __m512 iz = _mm512_div_ps(one, p[2]);
    const __m512 u = _mm512_mul_ps(p[0], iz), v = _mm512_mul_ps(p[1], iz);
    const __m512 ku = _mm512_fmadd_ps(All(in.fx), u, All(in.cx)), kv = _mm512_fmadd_ps(All(in.fy), v, All(in.cy));
    __mmask16 inside = _mm512_mask_cmp_ps_mask(lanes, p[2], All(1e-3f), _CMP_GT_OQ);
    inside = _mm512_mask_cmp_ps_mask(inside, ku, two, _CMP_GT_OQ);
    inside = _mm512_mask_cmp_ps_mask(inside, kv, two, _CMP_GT_OQ);
    inside = _mm512_mask_cmp_ps_mask(inside, ku, x_limit, _CMP_LT_OQ);
    inside = _mm512_mask_cmp_ps_mask(inside, kv, y_limit, _CMP_LT_OQ);
    if (inside == 0) continue;
    // Outside lanes read a harmless place.
    __m512 value, gx, gy;
    SampleSixteen(in.image, in.width, _mm512_mask_mov_ps(two, inside, ku), _mm512_mask_mov_ps(two, inside, kv), &value,
                  &gx, &gy);
    const __m512 gain_color = _mm512_mul_ps(All(in.gain), color);
    const __m512 residual = _mm512_sub_ps(value, _mm512_add_ps(gain_color, All(in.offset)));
    const __m512 magnitude = _mm512_abs_ps(residual);
    const __mmask16 saturated = _mm512_mask_cmp_ps_mask(inside, magnitude, All(in.cutoff), _CMP_GT_OQ);
    const __mmask16 good = static_cast<__mmask16>(inside & ~saturated);
    sums->visible += __builtin_popcount(inside);
    sums->saturated += __builtin_popcount(saturated);
    const __m512 huber = All(in.huber);
    const __m512 weight = _mm512_maskz_div_ps(good, huber, _mm512_max_ps(magnitude, huber));
    const __m512 c = _mm512_min_ps(magnitude, huber);
    energy = _mm512_mask3_fmadd_ps(c, _mm512_sub_ps(_mm512_add_ps(magnitude, magnitude), c), energy, good);
    energy = _mm512_mask_add_ps(energy, saturated, energy, saturated_energy);

    const __m512 nid = _mm512_mul_ps(id, iz);
    const __m512 jx = _mm512_mul_ps(gx, All(in.fx)), jy = _mm512_mul_ps(gy, All(in.fy));
    const __m512 along = _mm512_fmadd_ps(u, jx, _mm512_mul_ps(v, jy));
    const __m512 columns[kColumns] = {_mm512_mul_ps(jx, nid),
                                      _mm512_mul_ps(jy, nid),
                                      _mm512_fnmadd_ps(nid, along, _mm512_setzero_ps()),
                                      _mm512_fnmsub_ps(v, along, jy),
                                      _mm512_fmadd_ps(u, along, jx),
                                      _mm512_fmsub_ps(u, jy, _mm512_mul_ps(v, jx)),
                                      _mm512_sub_ps(_mm512_setzero_ps(), gain_color),
                                      All(-1.0f),
                                      residual};
    // Masked once: what a lane outside computed may not even be finite.
    __m512 j[kColumns];
    for (int a = 0; a < kColumns; ++a) j[a] = _mm512_maskz_mov_ps(good, columns[a]);
    int n = 0;
#pragma GCC unroll 9
    for (int a = 0; a < kTrackingUnknowns; ++a) {
      const __m512 wj = _mm512_mul_ps(weight, j[a]);
#pragma GCC unroll 9
      for (int b = a; b < kColumns; ++b, ++n) products[n] = _mm512_fmadd_ps(wj, j[b], products[n]);
    }
  }
  int n = 0;
  for (int a = 0; a < kTrackingUnknowns; ++a) {
    for (int b = a; b < kTrackingUnknowns; ++b, ++n) {
      sums->h[a * kTrackingUnknowns + b] = sums->h[b * kTrackingUnknowns + a] = _mm512_reduce_add_ps(products[n]);
    }
    sums->b[a] = _mm512_reduce_add_ps(products[n++]);
  }
  sums->energy = _mm512_reduce_add_ps(energy);
}

}  // namespace cairn::direct
