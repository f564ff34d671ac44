#include "optimization/schur_kernel.h"

#include "base/cpu_features.h"
#include "optimization/schur_kernel.inl"

namespace cairn::optimization::internal {

SchurKernel SchurKernelBaseline() { return {LinearizeBody, EliminateBody}; }

SchurKernel SchurKernelFor(SimdLevel level) {
  return level == SimdLevel::kBaseline ? SchurKernelBaseline() : SchurKernelAvx2();
}

}  // namespace cairn::optimization::internal
