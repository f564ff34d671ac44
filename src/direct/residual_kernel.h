// The photometric residual of one point in one target keyframe (DSO Eq. 4) and the sums that its normal equations need.
//
// r_k = I_t(p'_k) - offset - gain * (I_h(p_k) - host_offset) over the 8 pixels of the pattern. All share one inverse
// depth and (to first order) one geometric Jacobian, so 14 sums over the pattern are enough. Plain pointers, no Eigen.
#pragma once

namespace cairn {
enum class SimdLevel;  // base/cpu_features.h
}

namespace cairn::direct {

inline constexpr int kPatternSize = 8;
// DSO Fig. 4, pattern 8.
inline constexpr float kPatternX[kPatternSize] = {0, -1, 1, -2, 0, 2, -1, 0};
inline constexpr float kPatternY[kPatternSize] = {-2, -1, -1, 0, 0, 0, 1, 2};
inline constexpr int kPatternRadiusPx = 2;

// From a host to a target keyframe, at the current estimate.
struct PairProjection {
  float warp[9] = {};   // K R K^-1, row-major
  float shift[3] = {};  // K t
  float gain = 1.0f;
  float offset = 0.0f;       // b of the target
  float host_offset = 0.0f;  // b of the host
  // At the linearization point, for the Jacobian by the log gain: -gain0 * (I_h - host_offset0).
  float linear_gain = 1.0f;
  float linear_host_offset = 0.0f;
};

struct ResidualKernelInput {
  float x = 0.0f, y = 0.0f, inverse_depth = 0.0f;
  const float* color = nullptr;   // kPatternSize intensities of the host
  const float* weight = nullptr;  // kPatternSize gradient weights
  const PairProjection* pair = nullptr;
  const float* image = nullptr;  // level 0 of the target, ImagePyramid layout
  int width = 0, height = 0;
  float huber = 9.0f;
};

// Sums over the pattern, each times the weight. The kernels write them in this order, as one array.
struct ResidualSums {
  float gxx = 0.0f, gxy = 0.0f, gyy = 0.0f;  // image gradient products
  float gxa = 0.0f, gya = 0.0f;              // gradient times d/d(log gain)
  float gxb = 0.0f, gyb = 0.0f;              // gradient times d/d(offset)
  float aa = 0.0f, ab = 0.0f, bb = 0.0f;
  float gxr = 0.0f, gyr = 0.0f, ar = 0.0f, br = 0.0f;  // each times the residual
  float energy = 0.0f;                                 // sum of w_g * Huber
  float padding = 0.0f;
  bool inside = false;  // false: the sums mean nothing
};

void ResidualKernelBaseline(const ResidualKernelInput& input, ResidualSums* sums);
void ResidualKernelAvx2(const ResidualKernelInput& input, ResidualSums* sums);

using ResidualKernel = void (*)(const ResidualKernelInput&, ResidualSums*);
ResidualKernel ResidualKernelFor(SimdLevel level);

}  // namespace cairn::direct
