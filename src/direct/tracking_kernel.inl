// Body of the tracking kernel, compiled once per instruction set. See tracking_kernel.h.
#include "direct/lanes.h"
#include "direct/tracking_kernel.h"

namespace cairn::direct {
namespace {

constexpr int kLanes = 8;
constexpr int kColumns = kTrackingUnknowns + 1;  // Jacobian and residual
constexpr int kProducts = kColumns * (kColumns + 1) / 2;

inline void TrackingKernelBody(const TrackingKernelInput& in, TrackingKernelSums* sums) {
  V8 products[kProducts] = {};
  V8 energy = {};
  V8i visible_count = {}, saturated_count = {};
  const float* r = in.rotation_rays;
  const float x_limit = static_cast<float>(in.width - 3), y_limit = static_cast<float>(in.height - 3);
  const float saturated_energy = in.huber * (2.0f * in.cutoff - in.huber);
  const V8 zero = {};
  const V8 one = zero + 1.0f;
  for (int i = 0; i < in.count; i += kLanes) {
    V8 x, y, id, color;
    Load(in.x + i, &x), Load(in.y + i, &y), Load(in.inverse_depth + i, &id), Load(in.color + i, &color);
    const V8 px = r[0] * x + r[1] * y + (r[2] + in.translation[0] * id);
    const V8 py = r[3] * x + r[4] * y + (r[5] + in.translation[1] * id);
    const V8 pz = r[6] * x + r[7] * y + (r[8] + in.translation[2] * id);
    const V8 iz = one / pz;
    const V8 u = px * iz, v = py * iz;
    const V8 ku = in.fx * u + in.cx, kv = in.fy * v + in.cy;
    const V8i inside = (pz > 1e-3f) & (ku > 2.0f) & (kv > 2.0f) & (ku < x_limit) & (kv < y_limit);
    if (!AnyLane(inside)) continue;
    // Outside lanes read a harmless place.
    V8 value, gx, gy;
    SampleEight(in.image, in.width, inside ? ku : zero + 2.0f, inside ? kv : zero + 2.0f, &value, &gx, &gy);
    const V8 residual = value - (in.gain * color + in.offset);
    const V8 magnitude = residual < 0.0f ? -residual : residual;
    const V8i saturated = inside & (magnitude > in.cutoff);
    const V8i good = inside & ~saturated;
    const V8 huber = magnitude < in.huber ? one : in.huber / magnitude;
    const V8 weight = good ? huber : zero;
    const V8 huber_energy = weight * residual * residual * (2.0f - weight);
    energy += good ? huber_energy : (saturated ? zero + saturated_energy : zero);
    visible_count -= inside;
    saturated_count -= saturated;

    const V8 nid = id * iz;
    const V8 jx = gx * in.fx, jy = gy * in.fy;
    const V8 uv = u * v;
    // Masked once: what a lane outside computed may not even be finite.
    const V8 gain_color = in.gain * color;
    const V8 columns[kColumns] = {jx * nid,
                                  jy * nid,
                                  -nid * (u * jx + v * jy),
                                  -(uv * jx + (one + v * v) * jy),
                                  (one + u * u) * jx + uv * jy,
                                  u * jy - v * jx,
                                  -gain_color,
                                  zero - 1.0f,
                                  residual};
    V8 j[kColumns];
#pragma GCC unroll 9
    for (int a = 0; a < kColumns; ++a) j[a] = good ? columns[a] : zero;
    int n = 0;
#pragma GCC unroll 9
    for (int a = 0; a < kColumns; ++a) {
      const V8 wj = weight * j[a];
#pragma GCC unroll 9
      for (int b = a; b < kColumns; ++b) products[n++] += wj * j[b];
    }
  }
  static_assert(kProducts == 45);
  alignas(32) float totals[48];
  for (int n = 0; n < 44; n += 4) SumOfFour(products[n], products[n + 1], products[n + 2], products[n + 3], totals + n);
  SumOfFour(energy, zero, zero, zero, totals + 44);  // the last product, r * r, is not needed
  int n = 0;
  for (int a = 0; a < kTrackingUnknowns; ++a) {
    for (int b = a; b < kTrackingUnknowns; ++b, ++n) {
      sums->h[a * kTrackingUnknowns + b] = sums->h[b * kTrackingUnknowns + a] = totals[n];
    }
    sums->b[a] = totals[n++];
  }
  sums->energy = totals[44];
  sums->visible = sums->saturated = 0;
  for (int k = 0; k < kLanes; ++k) {
    sums->visible += visible_count[k];
    sums->saturated += saturated_count[k];
  }
}

}  // namespace
}  // namespace cairn::direct
