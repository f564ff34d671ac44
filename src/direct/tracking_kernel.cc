#include "direct/tracking_kernel.h"

#include "base/cpu_features.h"
#include "direct/tracking_kernel.inl"

namespace cairn::direct {

void TrackingKernelBaseline(const TrackingKernelInput& input, TrackingKernelSums* sums) {
  TrackingKernelBody(input, sums);
}

TrackingKernel TrackingKernelFor(SimdLevel level) {
  switch (level) {
    case SimdLevel::kAvx512:
      return TrackingKernelAvx512;
    case SimdLevel::kAvx2:
      return TrackingKernelAvx2;
    case SimdLevel::kBaseline:
      break;
  }
  return TrackingKernelBaseline;
}

}  // namespace cairn::direct
