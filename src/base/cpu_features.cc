#include "base/cpu_features.h"

#include <algorithm>
#include <cstdlib>
#include <string>

#include "absl/strings/str_cat.h"

namespace cairn {

std::string_view ToString(SimdLevel level) {
  switch (level) {
    case SimdLevel::kAvx512:
      return "avx512";
    case SimdLevel::kAvx2:
      return "avx2";
    case SimdLevel::kBaseline:
      break;
  }
  return "baseline";
}

absl::StatusOr<SimdLevel> ParseSimdLevel(std::string_view text) {
  for (const SimdLevel level : {SimdLevel::kBaseline, SimdLevel::kAvx2, SimdLevel::kAvx512}) {
    if (text == ToString(level)) return level;
  }
  return absl::InvalidArgumentError(
      absl::StrCat("the SIMD level (CAIRN_SIMD) is \"", std::string(text), "\" but must be baseline, avx2 or avx512"));
}

SimdLevel SupportedSimdLevel() {
  if (!__builtin_cpu_supports("avx2") || !__builtin_cpu_supports("fma") || !__builtin_cpu_supports("popcnt")) {
    return SimdLevel::kBaseline;
  }
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  return avx512 ? SimdLevel::kAvx512 : SimdLevel::kAvx2;
}

std::vector<SimdLevel> SupportedSimdLevels() {
  std::vector<SimdLevel> levels;
  for (const SimdLevel level : {SimdLevel::kBaseline, SimdLevel::kAvx2, SimdLevel::kAvx512}) {
    if (level <= SupportedSimdLevel()) levels.push_back(level);
  }
  return levels;
}

absl::StatusOr<SimdLevel> RequestedSimdLevel() {
  const char* cap = std::getenv("CAIRN_SIMD");
  if (cap == nullptr || *cap == '\0') return SupportedSimdLevel();
  absl::StatusOr<SimdLevel> level = ParseSimdLevel(cap);
  if (level.ok()) level = std::min(*level, SupportedSimdLevel());
  return level;
}

SimdLevel ActiveSimdLevel() { return RequestedSimdLevel().value_or(SupportedSimdLevel()); }

}  // namespace cairn
