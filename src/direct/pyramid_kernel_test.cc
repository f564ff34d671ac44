#include "direct/pyramid_kernel.h"

#include <gtest/gtest.h>

#include <vector>

#include "base/cpu_features.h"
#include "base/random.h"

namespace cairn::direct {
namespace {

// Widths around the register sizes, so that every remainder occurs.
constexpr int kWidths[] = {3, 8, 9, 15, 16, 17, 31, 33, 47, 100};

template <class T>
std::vector<T> RandomRow(int size, Random* random) {
  std::vector<T> row(size);
  for (T& v : row) v = static_cast<T>(random->Uniform(0.0, 255.0));
  return row;
}

class PyramidKernel : public ::testing::TestWithParam<SimdLevel> {
 protected:
  const PyramidKernels& kernels_ = PyramidKernelsFor(GetParam());
  const PyramidKernels& scalar_ = PyramidKernelsFor(SimdLevel::kBaseline);
  Random random_{7};
};

TEST_P(PyramidKernel, HalvesAndConvertsLikeTheScalarOne) {
  for (const int width : kWidths) {
    const auto a = RandomRow<unsigned char>(2 * width, &random_), b = RandomRow<unsigned char>(2 * width, &random_);
    const auto c = RandomRow<float>(2 * width, &random_), d = RandomRow<float>(2 * width, &random_);
    // One more value: nothing may be written behind the row.
    std::vector<float> want(width + 1, -1.0f), got(width + 1, -1.0f);
    scalar_.halve_bytes(a.data(), b.data(), width, want.data());
    kernels_.halve_bytes(a.data(), b.data(), width, got.data());
    EXPECT_EQ(want, got) << width;
    scalar_.convert_bytes(a.data(), width, want.data());
    kernels_.convert_bytes(a.data(), width, got.data());
    EXPECT_EQ(want, got) << width;
    scalar_.halve_floats(c.data(), d.data(), width, want.data());
    kernels_.halve_floats(c.data(), d.data(), width, got.data());
    for (int x = 0; x <= width; ++x) EXPECT_NEAR(want[x], got[x], 1e-4f) << x << " of " << width;
  }
}

TEST_P(PyramidKernel, GradientsAreCentralDifferences) {
  for (const int width : kWidths) {
    const int padded = width + 2 * kPyramidPadding;
    const auto above_row = RandomRow<float>(padded, &random_), row_row = RandomRow<float>(padded, &random_),
               below_row = RandomRow<float>(padded, &random_);
    const float *above = &above_row[kPyramidPadding], *row = &row_row[kPyramidPadding],
                *below = &below_row[kPyramidPadding];
    std::vector<float> out(4 * width + 1, -1.0f);
    kernels_.add_gradients(above, row, below, width, out.data());
    for (int x = 0; x < width; ++x) {
      const bool inside = x > 0 && x + 1 < width;
      const float dx = inside ? 0.5f * (row[x + 1] - row[x - 1]) : 0.0f;
      const float dy = inside ? 0.5f * (below[x] - above[x]) : 0.0f;
      EXPECT_EQ(out[4 * x], row[x]);
      EXPECT_EQ(out[4 * x + 1], dx) << x << " of " << width;
      EXPECT_EQ(out[4 * x + 2], dy) << x << " of " << width;
      EXPECT_NEAR(out[4 * x + 3], dx * dx + dy * dy, 1e-2f) << x << " of " << width;
    }
    EXPECT_EQ(out[4 * width], -1.0f);
  }
}

INSTANTIATE_TEST_SUITE_P(AllLevels, PyramidKernel, ::testing::ValuesIn(SupportedSimdLevels()),
                         [](const auto& level) { return std::string(ToString(level.param)); });

}  // namespace
}  // namespace cairn::direct
