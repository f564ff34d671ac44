#include "direct/trace_kernel.h"

#include <cmath>

#include "base/cpu_features.h"

namespace cairn::direct {
namespace {

// Intensity and gradient, bilinear; the position must be inside.
struct Sample {
  float value, dx, dy;
};

Sample SampleAt(const float* image, int width, float x, float y) {
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const float ax = x - static_cast<float>(ix), ay = y - static_cast<float>(iy);
  const float* p = image + 4 * (static_cast<long>(iy) * width + ix);
  const float* q = p + 4 * static_cast<long>(width);
  const float w00 = (1 - ax) * (1 - ay), w10 = ax * (1 - ay), w01 = (1 - ax) * ay, w11 = ax * ay;
  return {w00 * p[0] + w10 * p[4] + w01 * q[0] + w11 * q[4], w00 * p[1] + w10 * p[5] + w01 * q[1] + w11 * q[5],
          w00 * p[2] + w10 * p[6] + w01 * q[2] + w11 * q[6]};
}

float ValueAt(const float* image, int width, float x, float y) {
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const float ax = x - static_cast<float>(ix), ay = y - static_cast<float>(iy);
  const float* p = image + 4 * (static_cast<long>(iy) * width + ix);
  const float* q = p + 4 * static_cast<long>(width);
  const float top = p[0] + ax * (p[4] - p[0]), low = q[0] + ax * (q[4] - q[0]);
  return top + ay * (low - top);
}

void Energies(const TraceLine& line, float first, float step, int count, float* energies) {
  const TracePattern& pattern = *line.pattern;
  const float right = static_cast<float>(line.width) - line.border - 1.0f;
  const float bottom = static_cast<float>(line.height) - line.border - 1.0f;
  for (int i = 0; i < count; ++i) {
    const float t = first + static_cast<float>(i) * step;
    const float x = line.x + t * line.dx, y = line.y + t * line.dy;
    energies[i] = kOutsideEnergy;
    if (!(x > line.border && y > line.border && x < right && y < bottom)) continue;
    float energy = 0.0f;
    for (int k = 0; k < kPatternSize; ++k) {
      const float r = ValueAt(line.image, line.width, x + pattern.dx[k], y + pattern.dy[k]) - pattern.expected[k];
      const float magnitude = std::abs(r);
      energy += magnitude < line.huber ? r * r : line.huber * (2.0f * magnitude - line.huber);
    }
    energies[i] = energy;
  }
}

void Derivative(const TraceLine& line, float x, float y, TraceSums* sums) {
  const TracePattern& pattern = *line.pattern;
  *sums = TraceSums();
  for (int k = 0; k < kPatternSize; ++k) {
    const Sample sample = SampleAt(line.image, line.width, x + pattern.dx[k], y + pattern.dy[k]);
    const float r = sample.value - pattern.expected[k];
    const float j = line.dx * sample.dx + line.dy * sample.dy;
    const float magnitude = std::abs(r);
    const float w = magnitude < line.huber ? 1.0f : line.huber / magnitude;
    sums->h += w * j * j;
    sums->b += w * j * r;
    sums->energy += w * r * r * (2.0f - w);
  }
}

}  // namespace

const TraceKernels internal::kTraceBaseline = {Energies, Derivative};

const TraceKernels& TraceKernelsFor(SimdLevel level) {
  return level == SimdLevel::kBaseline ? internal::kTraceBaseline : internal::kTraceAvx2;
}

}  // namespace cairn::direct
