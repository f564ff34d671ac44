#include "optimization/schur_kernel.h"
#include "optimization/schur_kernel.inl"

namespace cairn::optimization::internal {

SchurKernel SchurKernelAvx2() { return {LinearizeBody, EliminateBody}; }

}  // namespace cairn::optimization::internal
