#include "base/cpu_features.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

namespace cairn {
namespace {

class CpuFeatures : public ::testing::Test {
 protected:
  void SetUp() override {
    if (const char* set = std::getenv("CAIRN_SIMD")) before_ = set;
  }
  void TearDown() override {
    if (before_.empty()) {
      unsetenv("CAIRN_SIMD");
    } else {
      setenv("CAIRN_SIMD", before_.c_str(), 1);
    }
  }
  std::string before_;
};

TEST_F(CpuFeatures, NamesReadBack) {
  for (const SimdLevel level : {SimdLevel::kBaseline, SimdLevel::kAvx2, SimdLevel::kAvx512}) {
    EXPECT_EQ(*ParseSimdLevel(ToString(level)), level);
  }
  EXPECT_EQ(ParseSimdLevel("sse9").status().code(), absl::StatusCode::kInvalidArgument);
}

TEST_F(CpuFeatures, TheEnvironmentCapsTheLevel) {
  unsetenv("CAIRN_SIMD");
  EXPECT_EQ(ActiveSimdLevel(), SupportedSimdLevel());
  setenv("CAIRN_SIMD", "baseline", 1);
  EXPECT_EQ(ActiveSimdLevel(), SimdLevel::kBaseline);
  setenv("CAIRN_SIMD", "avx512", 1);
  EXPECT_EQ(ActiveSimdLevel(), SupportedSimdLevel());  // never more than there is
}

TEST_F(CpuFeatures, AnUnknownLevelIsAnErrorThatNamesTheChoices) {
  setenv("CAIRN_SIMD", "fast", 1);
  EXPECT_THAT(std::string(RequestedSimdLevel().status().message()), ::testing::HasSubstr("avx2"));
  EXPECT_EQ(ActiveSimdLevel(), SupportedSimdLevel());
}

TEST_F(CpuFeatures, SupportedLevelsAscendFromTheBaseline) {
  const std::vector<SimdLevel> levels = SupportedSimdLevels();
  ASSERT_FALSE(levels.empty());
  EXPECT_EQ(levels.front(), SimdLevel::kBaseline);
  EXPECT_EQ(levels.back(), SupportedSimdLevel());
}

}  // namespace
}  // namespace cairn
