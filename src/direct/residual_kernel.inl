// Body of the residual kernel, compiled once per instruction set. See residual_kernel.h.
#include "direct/lanes.h"
#include "direct/residual_kernel.h"

namespace cairn::direct {
namespace {

inline void ResidualKernelBody(const ResidualKernelInput& in, ResidualSums* sums) {
  const PairProjection& pair = *in.pair;
  const float* m = pair.warp;
  V8 x, y, color, gradient_weight;
  Load(kPatternX, &x), Load(kPatternY, &y), Load(in.color, &color), Load(in.weight, &gradient_weight);
  x += in.x;
  y += in.y;
  const V8 pz = m[6] * x + m[7] * y + (m[8] + pair.shift[2] * in.inverse_depth);
  const V8 iz = 1.0f / pz;
  const V8 ku = (m[0] * x + m[1] * y + (m[2] + pair.shift[0] * in.inverse_depth)) * iz;
  const V8 kv = (m[3] * x + m[4] * y + (m[5] + pair.shift[1] * in.inverse_depth)) * iz;
  const float x_limit = static_cast<float>(in.width) - 3.0f, y_limit = static_cast<float>(in.height) - 3.0f;
  const V8i inside = (pz > 1e-4f) & (ku > 2.0f) & (kv > 2.0f) & (ku < x_limit) & (kv < y_limit);
  int all = -1;
  for (int k = 0; k < kPatternSize; ++k) all &= inside[k];
  sums->inside = all != 0;
  if (!sums->inside) return;

  alignas(32) float value_of[kPatternSize], gx_of[kPatternSize], gy_of[kPatternSize];
  for (int k = 0; k < kPatternSize; ++k) {
    const float px = ku[k], py = kv[k];
    const int ix = static_cast<int>(px), iy = static_cast<int>(py);
    const float ax = px - static_cast<float>(ix), ay = py - static_cast<float>(iy);
    const float* p = in.image + 4 * (static_cast<long>(iy) * in.width + ix);
    const float* q = p + 4 * static_cast<long>(in.width);
    V4 p0, p1, q0, q1;
    Load(p, &p0), Load(p + 4, &p1), Load(q, &q0), Load(q + 4, &q1);
    const V4 top = p0 + ax * (p1 - p0), low = q0 + ax * (q1 - q0);
    const V4 sample = top + ay * (low - top);
    value_of[k] = sample[0], gx_of[k] = sample[1], gy_of[k] = sample[2];
  }
  V8 value, gx, gy;
  Load(value_of, &value), Load(gx_of, &gx), Load(gy_of, &gy);
  const V8 r = value - pair.offset - pair.gain * (color - pair.host_offset);
  const V8 magnitude = r < 0.0f ? -r : r;
  const V8 zero = {};
  const V8 huber = magnitude < in.huber ? zero + 1.0f : in.huber / magnitude;
  const V8 w = gradient_weight * huber;
  sums->energy = SumOf(w * r * r * (2.0f - huber));
  const V8 wx = w * gx, wy = w * gy;
  const V8 ja = -pair.linear_gain * (color - pair.linear_host_offset);
  sums->gxx = SumOf(wx * gx), sums->gxy = SumOf(wx * gy), sums->gyy = SumOf(wy * gy);
  sums->gxa = SumOf(wx * ja), sums->gya = SumOf(wy * ja);
  sums->gxb = -SumOf(wx), sums->gyb = -SumOf(wy);
  const V8 wa = w * ja, wr = w * r;
  sums->aa = SumOf(wa * ja), sums->ab = -SumOf(wa), sums->bb = SumOf(w);
  sums->gxr = SumOf(wx * r), sums->gyr = SumOf(wy * r), sums->ar = SumOf(wa * r), sums->br = -SumOf(wr);
}

}  // namespace
}  // namespace cairn::direct
