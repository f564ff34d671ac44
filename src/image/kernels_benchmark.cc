// The kernels of this folder at every SIMD level that this processor has. tools/simd_ratios prints the ratios.
#include <benchmark/benchmark.h>

#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "base/cpu_features.h"
#include "base/random.h"
#include "image/hamming.h"
#include "image/undistort_kernel.h"

namespace cairn::image {
namespace {

// 640 x 480 px through a lens that bends by up to 20 px.
template <class T>
void Undistort(benchmark::State& state,
               void (*kernel)(const RawImage<T>&, const std::int16_t*, const std::uint16_t*, int, T*)) {
  constexpr int kWidth = 640, kHeight = 480;
  cv::Mat map_x(kHeight, kWidth, CV_32FC1), map_y(kHeight, kWidth, CV_32FC1), xy, fraction;
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const float u = static_cast<float>(x - 320) / 400.0f, v = static_cast<float>(y - 240) / 400.0f;
      const float factor = 0.98f - 0.05f * (u * u + v * v);
      map_x.at<float>(y, x) = 320.0f + 400.0f * factor * u;
      map_y.at<float>(y, x) = 240.0f + 400.0f * factor * v;
    }
  }
  cv::convertMaps(map_x, map_y, xy, fraction, CV_16SC2, false);
  std::vector<T> raw(kWidth * kHeight), out(kWidth);
  for (std::size_t i = 0; i < raw.size(); ++i) raw[i] = static_cast<T>(i % 251);
  const RawImage<T> image = {raw.data(), kWidth, kWidth, kHeight};
  for (auto _ : state) {
    for (int y = 0; y < kHeight; ++y) {
      kernel(image, xy.ptr<std::int16_t>(y), fraction.ptr<std::uint16_t>(y), kWidth, out.data());
      benchmark::DoNotOptimize(out.data());
    }
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * kWidth * kHeight);
}

void UndistortBytes(benchmark::State& state, SimdLevel level) { Undistort(state, UndistortKernelsFor(level).bytes); }
void UndistortFloats(benchmark::State& state, SimdLevel level) { Undistort(state, UndistortKernelsFor(level).floats); }

void Hamming(benchmark::State& state, SimdLevel level) {
  Random random(1);
  std::vector<std::uint64_t> descriptors(4 * 1000);
  for (std::uint64_t& word : descriptors) word = random.Next();
  std::vector<std::uint16_t> distances(1000);
  const auto kernel =
      level == SimdLevel::kBaseline ? internal::HammingDistancesPortable : internal::HammingDistancesAvx2;
  for (auto _ : state) {
    kernel(descriptors.data(), descriptors.data(), 1000, distances.data());
    benchmark::DoNotOptimize(distances.data());
    benchmark::ClobberMemory();
  }
  state.SetItemsProcessed(state.iterations() * 1000);
}

}  // namespace

void RegisterAll() {
  struct {
    const char* name;
    void (*run)(benchmark::State&, SimdLevel);
  } const all[] = {{"undistort_bytes", UndistortBytes}, {"undistort_floats", UndistortFloats}, {"hamming", Hamming}};
  for (const auto& kernel : all) {
    for (const SimdLevel level : SupportedSimdLevels()) {
      benchmark::RegisterBenchmark((std::string(kernel.name) + "/" + std::string(ToString(level))).c_str(), kernel.run,
                                   level);
    }
  }
}

}  // namespace cairn::image

int main(int argc, char** argv) {
  cairn::image::RegisterAll();
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
}
