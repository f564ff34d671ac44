// Which instruction sets the SIMD kernels use. Every kernel exists at least for the processors of the ABI (baseline)
// and for AVX2 with FMA, some for AVX-512 too; *_avx2.cc and *_avx512.cc hold nothing but kernels behind plain
// pointers, so that no inline function compiled for them reaches a processor without them.
//
// The environment variable CAIRN_SIMD (baseline, avx2 or avx512) caps the level: for tests, benchmarks, and to get the
// same rounding on different machines.
#pragma once

#include <string_view>
#include <vector>

#include "absl/status/statusor.h"

namespace cairn {

enum class SimdLevel { kBaseline, kAvx2, kAvx512 };

std::string_view ToString(SimdLevel level);
// InvalidArgument, naming the choices, for any other text.
absl::StatusOr<SimdLevel> ParseSimdLevel(std::string_view text);

// The highest level that processor and operating system support.
SimdLevel SupportedSimdLevel();
// All levels up to it, ascending: what tests and benchmarks go through.
std::vector<SimdLevel> SupportedSimdLevels();

// The level to use: the supported one, capped by CAIRN_SIMD. InvalidArgument if the variable holds something else.
absl::StatusOr<SimdLevel> RequestedSimdLevel();
// The same; a CAIRN_SIMD that is no level caps nothing.
SimdLevel ActiveSimdLevel();

}  // namespace cairn
