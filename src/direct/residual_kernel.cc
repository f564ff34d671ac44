#include "direct/residual_kernel.h"

#include "direct/residual_kernel.inl"

namespace cairn::direct {

void ResidualKernelBaseline(const ResidualKernelInput& input, ResidualSums* sums) { ResidualKernelBody(input, sums); }

ResidualKernel BestResidualKernel() {
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") ? ResidualKernelAvx2 : ResidualKernelBaseline;
}
}  // namespace cairn::direct
