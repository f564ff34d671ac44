#include "direct/trace_kernel.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "base/cpu_features.h"
#include "base/random.h"

namespace cairn::direct {
namespace {

constexpr int kWidth = 64, kHeight = 48;

class TraceKernel : public ::testing::TestWithParam<SimdLevel> {
 protected:
  TraceKernel() {
    Random random(5);
    for (int i = 0; i < kWidth * kHeight * 4; ++i) image_.push_back(static_cast<float>(random.Uniform(-30.0, 90.0)));
    for (int k = 0; k < kPatternSize; ++k) {
      pattern_.dx[k] = kPatternX[k] * 1.1f + static_cast<float>(random.Uniform(-0.2, 0.2));
      pattern_.dy[k] = kPatternY[k] * 0.9f + static_cast<float>(random.Uniform(-0.2, 0.2));
      pattern_.expected[k] = static_cast<float>(random.Uniform(0.0, 60.0));
    }
    line_.image = image_.data(), line_.width = kWidth, line_.height = kHeight;
    line_.pattern = &pattern_;
    line_.border = 4.0f;
    line_.x = 12.3f, line_.y = 9.6f, line_.dx = 0.8f, line_.dy = 0.6f;
  }

  const TraceKernels& kernels_ = TraceKernelsFor(GetParam());
  const TraceKernels& scalar_ = TraceKernelsFor(SimdLevel::kBaseline);
  std::vector<float> image_;
  TracePattern pattern_;
  TraceLine line_;
};

TEST_P(TraceKernel, EnergiesEqualTheScalarOnes) {
  // From outside the image through it to the other side, an even and an odd number of places.
  for (const int count : {1, 2, 7, 60, 61}) {
    std::vector<float> want(count + 1, -1.0f), got(count + 1, -1.0f);
    scalar_.energies(line_, -14.0f, 1.21f, count, want.data());
    kernels_.energies(line_, -14.0f, 1.21f, count, got.data());
    for (int i = 0; i <= count; ++i) EXPECT_NEAR(want[i], got[i], 1e-4f * std::abs(want[i])) << i << " of " << count;
    EXPECT_EQ(got[0], kOutsideEnergy);
    if (count < 60) continue;
    EXPECT_LT(got[30], kOutsideEnergy);
    EXPECT_EQ(got[59], kOutsideEnergy);
  }
}

TEST_P(TraceKernel, DerivativeEqualsTheScalarOne) {
  for (float x = 5.0f; x < 58.0f; x += 3.7f) {
    TraceSums want, got;
    scalar_.derivative(line_, x, 0.6f * x + 4.0f, &want);
    kernels_.derivative(line_, x, 0.6f * x + 4.0f, &got);
    EXPECT_NEAR(want.h, got.h, 1e-4f * want.h);
    EXPECT_NEAR(want.b, got.b, 1e-4f * std::sqrt(want.h * want.energy));
    EXPECT_NEAR(want.energy, got.energy, 1e-4f * want.energy);
  }
}

TEST_P(TraceKernel, DerivativeIsThatOfTheEnergy) {
  // Intensity linear in the image, gradients to match: differences of the energy are exact.
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      float* pixel = &image_[4 * (y * kWidth + x)];
      pixel[0] = 20.0f + 0.5f * static_cast<float>(x) - 0.25f * static_cast<float>(y);
      pixel[1] = 0.5f, pixel[2] = -0.25f;
    }
  }
  line_.huber = 1e4f;
  TraceSums sums;
  kernels_.derivative(line_, line_.x + 5.0f * line_.dx, line_.y + 5.0f * line_.dy, &sums);
  float energies[2];
  kernels_.energies(line_, 4.75f, 0.5f, 2, energies);
  EXPECT_NEAR((energies[1] - energies[0]) / 0.5f, 2.0f * sums.b, 0.02f * std::abs(sums.b) + 0.1f);
}

INSTANTIATE_TEST_SUITE_P(AllLevels, TraceKernel, ::testing::ValuesIn(SupportedSimdLevels()),
                         [](const auto& level) { return std::string(ToString(level.param)); });

}  // namespace
}  // namespace cairn::direct
