// The inner loops of ImagePyramid, one image row at a time: gray rows from the input, 2x2 means, and the interleaving
// of a gray row with its gradients. Plain pointers, no alignment needed.
#pragma once

namespace cairn {
enum class SimdLevel;  // base/cpu_features.h
}

namespace cairn::direct {

inline constexpr int kPyramidPadding = 16;

struct PyramidKernels {
  // Means of 2 x 2 pixels of two rows of at least 2 * width pixels.
  void (*halve_bytes)(const unsigned char* top, const unsigned char* low, int width, float* out);
  void (*halve_floats)(const float* top, const float* low, int width, float* out);
  void (*convert_bytes)(const unsigned char* row, int width, float* out);
  // {intensity, d/dx, d/dy, squared gradient} of one row from it and its neighbours; central differences, 0 in the
  // first and last column. kPyramidPadding floats before and behind each row are read, their values do not matter.
  // Fastest with `out` on a cache line.
  void (*add_gradients)(const float* above, const float* row, const float* below, int width, float* out);
};

const PyramidKernels& PyramidKernelsFor(SimdLevel level);

namespace internal {
extern const PyramidKernels kPyramidBaseline, kPyramidAvx2, kPyramidAvx512;
}  // namespace internal

}  // namespace cairn::direct
