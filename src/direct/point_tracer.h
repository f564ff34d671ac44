// Candidate points are traced along their epipolar line in every new frame until their inverse depth is known well
// enough to activate them (DSO Sec. 3.2).
#pragma once

#include "base/cpu_features.h"
#include "direct/keyframe.h"
#include "direct/trace_kernel.h"

namespace cairn::direct {

struct TraceOptions {
  double max_search_px = 15.0;
  double slack_px = 1.5;
  double huber_gray = 9.0;
  int refinement_steps = 3;
  const TraceKernels* kernels = &TraceKernelsFor(ActiveSimdLevel());
};

// A candidate at an integer pixel of level 0, at least kPatternRadiusPx + 1 from the border; false where it has no
// texture.
bool MakeImmaturePoint(const ImagePyramid& image, int x, int y, double gradient_constant_gray, double outlier_gray,
                       ImmaturePoint* point);

// Narrows the point's interval with one image. `pair` goes from the host to the image.
TraceStatus TracePoint(const ImagePyramid& image, const PairProjection& pair, const TraceOptions& options,
                       ImmaturePoint* point);

// K R K^-1 and K t and the brightness transfer of host to target; the linearization is that of the same state.
PairProjection MakePairProjection(const Pinhole& camera, const SE3& target_from_host, double gain, double target_offset,
                                  double host_offset);
inline constexpr float kMinDepthRatio = 1e-3f;
// The pixel of the target where a pixel of the host with this inverse depth is seen. Returns the ratio of the depths,
// target to host; nothing is projected where it is below kMinDepthRatio: behind the camera, or as good as.
float ProjectInto(const PairProjection& pair, float x, float y, float inverse_depth, float* u, float* v);

}  // namespace cairn::direct
