#include "direct/pyramid_kernel.h"

#include "base/cpu_features.h"

namespace cairn::direct {
namespace {

template <class T>
void Halve(const T* top, const T* low, int width, float* out) {
  for (int x = 0; x < width; ++x) {
    out[x] = 0.25f * static_cast<float>(top[2 * x] + top[2 * x + 1] + low[2 * x] + low[2 * x + 1]);
  }
}

void ConvertBytes(const unsigned char* row, int width, float* out) {
  for (int x = 0; x < width; ++x) out[x] = static_cast<float>(row[x]);
}

void AddGradients(const float* above, const float* row, const float* below, int width, float* out) {
  for (int x = 1; x + 1 < width; ++x) {
    const float dx = 0.5f * (row[x + 1] - row[x - 1]), dy = 0.5f * (below[x] - above[x]);
    out[4 * x] = row[x];
    out[4 * x + 1] = dx;
    out[4 * x + 2] = dy;
    out[4 * x + 3] = dx * dx + dy * dy;
  }
  for (const int x : {0, width - 1}) {
    out[4 * x] = row[x];
    out[4 * x + 1] = out[4 * x + 2] = out[4 * x + 3] = 0.0f;
  }
}

}  // namespace

const PyramidKernels internal::kPyramidBaseline = {Halve<unsigned char>, Halve<float>, ConvertBytes, AddGradients};

const PyramidKernels& PyramidKernelsFor(SimdLevel level) {
  switch (level) {
    case SimdLevel::kAvx512:
      return internal::kPyramidAvx512;
    case SimdLevel::kAvx2:
      return internal::kPyramidAvx2;
    case SimdLevel::kBaseline:
      break;
  }
  return internal::kPyramidBaseline;
}

}  // namespace cairn::direct
