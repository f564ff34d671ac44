// The inner loops of PointTracer: the energy of the residual pattern at equidistant places of an epipolar line, and its
// derivative along the line at one place. Plain pointers.
#pragma once

#include "direct/residual_kernel.h"

namespace cairn {
enum class SimdLevel;  // base/cpu_features.h
}

namespace cairn::direct {

// The pattern turned and scaled like the image around the point, and what it should look like there.
struct TracePattern {
  float dx[kPatternSize], dy[kPatternSize];  // pixels from the centre
  float expected[kPatternSize];              // gray
};

struct TraceLine {
  const float* image = nullptr;  // level 0, ImagePyramid layout
  int width = 0, height = 0;
  const TracePattern* pattern = nullptr;
  float border = 0.0f;  // pixels; a centre nearer to the edge of the image is outside; covers the pattern
  float huber = 9.0f;
  // The place at parameter t is (x + t * dx, y + t * dy).
  float x = 0.0f, y = 0.0f, dx = 0.0f, dy = 0.0f;
};

inline constexpr float kOutsideEnergy = 1e30f;

// Of a step of Gauss-Newton along the line.
struct TraceSums {
  float h = 0.0f;       // sum of weight times squared derivative
  float b = 0.0f;       // ... of weight times derivative times residual
  float energy = 0.0f;  // Huber
};

struct TraceKernels {
  // energies[i] at parameter first + i * step for i < count, kOutsideEnergy outside.
  void (*energies)(const TraceLine& line, float first, float step, int count, float* energies);
  // At a place inside.
  void (*derivative)(const TraceLine& line, float x, float y, TraceSums* sums);
};

const TraceKernels& TraceKernelsFor(SimdLevel level);

namespace internal {
extern const TraceKernels kTraceBaseline, kTraceAvx2;
}  // namespace internal

}  // namespace cairn::direct
