// The inner loop of coarse-to-fine tracking (DSO Sec. 3.1): residuals, weights and normal equations of one pyramid
// level.
//
// r = I_new(p') - gain * color - offset, with p' the projection of (x, y, inverse depth) of the reference keyframe; the
// unknowns are a left increment of new_from_reference (translation, rotation), the log gain and the offset. Pure
// pointers, no Eigen, so that a variant for wider registers may be chosen at run time.
#pragma once

namespace cairn {
enum class SimdLevel;  // base/cpu_features.h
}

namespace cairn::direct {

struct TrackingKernelInput {
  const float* x =
      nullptr;  // pixels of the level in the reference; `count` is a multiple of 8, padded by far-out pixels
  const float* y = nullptr;
  const float* inverse_depth = nullptr;
  const float* color = nullptr;  // reference intensity minus the reference's offset
  int count = 0;
  const float* image = nullptr;  // ImagePyramid::Level of the new frame
  int width = 0;
  int height = 0;
  float rotation_rays[9] = {};  // R * K^-1, row-major
  float translation[3] = {};
  float fx = 0.0f, fy = 0.0f, cx = 0.0f, cy = 0.0f;
  float gain = 1.0f;
  float offset = 0.0f;
  float huber = 9.0f;
  float cutoff = 20.0f;  // a larger |r| adds a constant to the energy and nothing to the equations
};

inline constexpr int kTrackingUnknowns = 8;

struct TrackingKernelSums {
  float h[kTrackingUnknowns * kTrackingUnknowns] = {};  // row-major, symmetric
  float b[kTrackingUnknowns] = {};                      // J^T W r
  float energy = 0.0f;                                  // Huber energy, clamped at the cutoff
  int visible = 0;                                      // inside the image
  int saturated = 0;                                    // of these, beyond the cutoff
};

void TrackingKernelBaseline(const TrackingKernelInput& input, TrackingKernelSums* sums);
void TrackingKernelAvx2(const TrackingKernelInput& input, TrackingKernelSums* sums);
void TrackingKernelAvx512(const TrackingKernelInput& input, TrackingKernelSums* sums);

using TrackingKernel = void (*)(const TrackingKernelInput&, TrackingKernelSums*);
TrackingKernel TrackingKernelFor(SimdLevel level);

}  // namespace cairn::direct
