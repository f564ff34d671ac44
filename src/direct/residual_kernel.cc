#include "direct/residual_kernel.h"

#include "base/cpu_features.h"
#include "direct/residual_kernel.inl"

namespace cairn::direct {

void ResidualKernelBaseline(const ResidualKernelInput& input, ResidualSums* sums) { ResidualKernelBody(input, sums); }

ResidualKernel ResidualKernelFor(SimdLevel level) {
  return level == SimdLevel::kBaseline ? ResidualKernelBaseline : ResidualKernelAvx2;
}
}  // namespace cairn::direct
