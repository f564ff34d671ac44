// Body of the residual kernel, compiled once per instruction set. See residual_kernel.h.
#include <cstddef>

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
  sums->inside = !AnyLane(~inside);
  if (!sums->inside) return;

  V8 value, gx, gy;
  SampleEight(in.image, in.width, ku, kv, &value, &gx, &gy);
  const V8 r = value - pair.offset - pair.gain * (color - pair.host_offset);
  const V8 magnitude = r < 0.0f ? -r : r;
  const V8 zero = {};
  const V8 huber = magnitude < in.huber ? zero + 1.0f : in.huber / magnitude;
  const V8 w = gradient_weight * huber;
  const V8 wx = w * gx, wy = w * gy, minus_w = -w;
  const V8 ja = -pair.linear_gain * (color - pair.linear_host_offset);  // d/d(log gain); d/d(offset) is -1
  const V8 wa = w * ja, wr = w * r;
  float f[16];
  SumOfFour(wx * gx, wx * gy, wy * gy, wx * ja, f);
  SumOfFour(wy * ja, minus_w * gx, minus_w * gy, wa * ja, f + 4);
  SumOfFour(minus_w * ja, w, wx * r, wy * r, f + 8);
  SumOfFour(wa * r, minus_w * r, wr * r * (2.0f - huber), zero, f + 12);
  static_assert(offsetof(ResidualSums, padding) == 15 * sizeof(float));
  std::memcpy(&sums->gxx, f, sizeof(f));
}

}  // namespace
}  // namespace cairn::direct
