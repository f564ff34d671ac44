#include "direct/tracking_kernel.h"

#include "base/cpu_features.h"
#include "direct/tracking_kernel.inl"

namespace cairn::direct {

void TrackingKernelBaseline(const TrackingKernelInput& input, TrackingKernelSums* sums) {
  TrackingKernelBody(input, sums);
}

TrackingKernel TrackingKernelFor(SimdLevel level) {
  return level == SimdLevel::kBaseline ? TrackingKernelBaseline : TrackingKernelAvx2;
}

}  // namespace cairn::direct
