#include "direct/tracking_kernel.h"
#include "direct/tracking_kernel.inl"

namespace cairn::direct {

void TrackingKernelAvx2(const TrackingKernelInput& input, TrackingKernelSums* sums) { TrackingKernelBody(input, sums); }

}  // namespace cairn::direct
