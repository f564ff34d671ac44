// The kernels of the odometry at every SIMD level that this processor has. tools/simd_ratios prints the ratios.
#include <benchmark/benchmark.h>

#include <cmath>
#include <string>
#include <vector>

#include "base/cpu_features.h"
#include "base/random.h"
#include "direct/image_pyramid.h"
#include "direct/pyramid_kernel.h"
#include "direct/residual_kernel.h"
#include "direct/trace_kernel.h"
#include "direct/tracking_kernel.h"

namespace cairn::direct {
namespace {

constexpr int kWidth = 320, kHeight = 240;  // half of VGA, as the odometry sees it

// Smooth texture, so that the branches of the kernels go as they do on images.
float Gray(float x, float y) {
  return 128.0f + 50.0f * std::sin(0.21f * x + 0.05f * y) + 40.0f * std::sin(0.13f * y - 0.07f * x);
}

std::vector<float> LevelZero() {
  std::vector<float> rows[3], image(4 * kWidth * kHeight);
  for (int y = 1; y + 1 < kHeight; ++y) {
    for (int k = 0; k < 3; ++k) {
      rows[k].resize(kWidth + 2 * kPyramidPadding);
      for (int x = 0; x < kWidth; ++x) {
        rows[k][kPyramidPadding + x] = Gray(static_cast<float>(x), static_cast<float>(y - 1 + k));
      }
    }
    PyramidKernelsFor(SimdLevel::kBaseline)
        .add_gradients(&rows[0][kPyramidPadding], &rows[1][kPyramidPadding], &rows[2][kPyramidPadding], kWidth,
                       &image[4 * kWidth * y]);
  }
  return image;
}

// All levels of one image of 640 x 480 px: at half resolution from bytes, from floats, and at full resolution.
void BuildPyramid(benchmark::State& state, SimdLevel level, bool floats, bool full_resolution) {
  Frame frame;
  frame.image = cv::Mat(2 * kHeight, 2 * kWidth, CV_8UC1);
  for (int y = 0; y < frame.image.rows; ++y) {
    for (int x = 0; x < frame.image.cols; ++x) {
      frame.image.at<unsigned char>(y, x) =
          static_cast<unsigned char>(Gray(0.5f * static_cast<float>(x), 0.5f * static_cast<float>(y)));
    }
  }
  if (floats) frame.image.convertTo(frame.corrected, CV_32F);
  Pinhole camera;
  camera.width_px = 2 * kWidth, camera.height_px = 2 * kHeight;
  camera.fx_px = camera.fy_px = 525.0, camera.cx_px = 320.0, camera.cy_px = 240.0;
  const PyramidGeometry geometry = PyramidGeometry::Make(camera, full_resolution, 6, 400);
  ImagePyramid pyramid(level);
  for (auto _ : state) {
    pyramid.Build(frame, geometry);
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * frame.image.rows * frame.image.cols);
}

void PyramidFromBytes(benchmark::State& state, SimdLevel level) { BuildPyramid(state, level, false, false); }
void PyramidFromFloats(benchmark::State& state, SimdLevel level) { BuildPyramid(state, level, true, false); }
void PyramidFull(benchmark::State& state, SimdLevel level) { BuildPyramid(state, level, false, true); }

void Gradients(benchmark::State& state, SimdLevel level) {
  const PyramidKernels& kernels = PyramidKernelsFor(level);
  constexpr int kPadded = kWidth + 2 * kPyramidPadding;
  std::vector<float> above(kPadded, 90.0f), row(kPadded, 100.0f), below(kPadded, 110.0f);
  alignas(64) static float out[4 * kWidth];
  for (auto _ : state) {
    kernels.add_gradients(&above[kPyramidPadding], &row[kPyramidPadding], &below[kPyramidPadding], kWidth, out);
    benchmark::DoNotOptimize(out);
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * kWidth);
}

struct TraceSetup {
  std::vector<float> image = LevelZero();
  TracePattern pattern;
  TraceLine line;

  TraceSetup() {
    for (int k = 0; k < kPatternSize; ++k) {
      pattern.dx[k] = 1.05f * kPatternX[k], pattern.dy[k] = 0.95f * kPatternY[k];
      pattern.expected[k] = Gray(110.0f + pattern.dx[k], 95.0f + pattern.dy[k]);
    }
    line.image = image.data(), line.width = kWidth, line.height = kHeight;
    line.pattern = &pattern;
    line.border = 4.0f;
    line.x = 104.3f, line.y = 91.2f, line.dx = 0.8f, line.dy = 0.6f;
  }
};

void TraceEnergies(benchmark::State& state, SimdLevel level) {
  const TraceKernels& kernels = TraceKernelsFor(level);
  const TraceSetup setup;
  float energies[12];
  for (auto _ : state) {
    kernels.energies(setup.line, 0.0f, 1.0f, 12, energies);
    benchmark::DoNotOptimize(energies);
  }
  state.SetItemsProcessed(state.iterations() * 12);
}

void TraceDerivative(benchmark::State& state, SimdLevel level) {
  const TraceKernels& kernels = TraceKernelsFor(level);
  const TraceSetup setup;
  TraceSums sums;
  for (auto _ : state) {
    kernels.derivative(setup.line, 108.1f, 94.3f, &sums);
    benchmark::DoNotOptimize(sums);
  }
  state.SetItemsProcessed(state.iterations());
}

void Tracking(benchmark::State& state, SimdLevel level) {
  const std::vector<float> image = LevelZero();
  Random random(1);
  std::vector<float> x, y, inverse_depth, color;
  for (int i = 0; i < 2048; ++i) {
    x.push_back(static_cast<float>(random.Uniform(5.0, kWidth - 6.0)));
    y.push_back(static_cast<float>(random.Uniform(5.0, kHeight - 6.0)));
    inverse_depth.push_back(static_cast<float>(random.Uniform(0.3, 1.5)));
    color.push_back(Gray(x.back(), y.back()) + static_cast<float>(random.Uniform(-12.0, 12.0)));
  }
  TrackingKernelInput input;
  input.x = x.data(), input.y = y.data(), input.inverse_depth = inverse_depth.data(), input.color = color.data();
  input.count = static_cast<int>(x.size());
  input.image = image.data(), input.width = kWidth, input.height = kHeight;
  input.fx = input.fy = 262.0f, input.cx = 159.5f, input.cy = 119.5f;
  const float rays[9] = {1.0f / 262.0f, 0.0f, -159.5f / 262.0f, 0.0f, 1.0f / 262.0f, -119.5f / 262.0f, 0.0f,
                         0.0f,          1.0f};
  for (int i = 0; i < 9; ++i) input.rotation_rays[i] = rays[i];
  input.translation[0] = 0.002f, input.translation[2] = 0.001f;
  const TrackingKernel kernel = TrackingKernelFor(level);
  TrackingKernelSums sums;
  for (auto _ : state) {
    kernel(input, &sums);
    benchmark::DoNotOptimize(sums);
  }
  state.SetItemsProcessed(state.iterations() * input.count);
}

void Residuals(benchmark::State& state, SimdLevel level) {
  const std::vector<float> image = LevelZero();
  PairProjection pair;
  const float warp[9] = {1.0f, 0.001f, 0.4f, -0.001f, 1.0f, -0.3f, 0.0f, 0.0f, 1.0f};
  for (int i = 0; i < 9; ++i) pair.warp[i] = warp[i];
  pair.shift[0] = 2.0f, pair.shift[1] = 1.0f;
  float color[64][kPatternSize], weight[kPatternSize];
  ResidualKernelInput input;
  input.weight = weight;
  input.pair = &pair;
  input.image = image.data(), input.width = kWidth, input.height = kHeight;
  for (float& w : weight) w = 0.7f;
  for (int i = 0; i < 64; ++i) {
    for (int k = 0; k < kPatternSize; ++k) {
      color[i][k] = Gray(30.0f + 4.0f * static_cast<float>(i) + kPatternX[k], 100.0f + kPatternY[k]);
    }
  }
  const ResidualKernel kernel = ResidualKernelFor(level);
  ResidualSums sums;
  for (auto _ : state) {
    for (int i = 0; i < 64; ++i) {
      input.x = 30.0f + 4.0f * static_cast<float>(i), input.y = 100.0f, input.inverse_depth = 0.8f;
      input.color = color[i];
      kernel(input, &sums);
      benchmark::DoNotOptimize(sums);
    }
  }
  state.SetItemsProcessed(state.iterations() * 64);
}

}  // namespace

void RegisterAll() {
  struct {
    const char* name;
    void (*run)(benchmark::State&, SimdLevel);
  } const all[] = {{"pyramid", PyramidFromBytes},
                   {"pyramid_from_floats", PyramidFromFloats},
                   {"pyramid_full", PyramidFull},
                   {"gradients", Gradients},
                   {"trace_energies", TraceEnergies},
                   {"trace_derivative", TraceDerivative},
                   {"tracking", Tracking},
                   {"residuals", Residuals}};
  for (const auto& kernel : all) {
    for (const SimdLevel level : SupportedSimdLevels()) {
      benchmark::RegisterBenchmark((std::string(kernel.name) + "/" + std::string(ToString(level))).c_str(), kernel.run,
                                   level);
    }
  }
}

}  // namespace cairn::direct

int main(int argc, char** argv) {
  cairn::direct::RegisterAll();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
}
