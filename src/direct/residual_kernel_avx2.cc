#include "direct/residual_kernel.h"
#include "direct/residual_kernel.inl"

namespace cairn::direct {

void ResidualKernelAvx2(const ResidualKernelInput& input, ResidualSums* sums) { ResidualKernelBody(input, sums); }

}  // namespace cairn::direct
