#include "direct/tracking_kernel.h"

#include "direct/tracking_kernel.inl"

namespace cairn::direct {

void TrackingKernelBaseline(const TrackingKernelInput& input, TrackingKernelSums* sums) {
  TrackingKernelBody(input, sums);
}

TrackingKernel BestTrackingKernel() {
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? TrackingKernelAvx2 : TrackingKernelBaseline;
}

}  // namespace cairn::direct
