// Eight floats at a time with the compiler's vector extension: the same source becomes two SSE registers in a baseline
// file and one AVX register in a *_avx2.cc file. Only to be used inside functions with internal linkage, so that no
// object file lends its code to a machine without the instructions.
#pragma once

#include <cstring>

namespace cairn::direct {

using V4 = float __attribute__((vector_size(16)));
using V8 = float __attribute__((vector_size(32)));
using V8i = int __attribute__((vector_size(32)));

// Internal linkage on purpose, see above. Vectors go by reference: passed by value their ABI depends on the target.
namespace {

[[maybe_unused]] inline void Load(const float* p, V4* v) { std::memcpy(v, p, sizeof(*v)); }
[[maybe_unused]] inline void Load(const float* p, V8* v) { std::memcpy(v, p, sizeof(*v)); }
[[maybe_unused]] inline float SumOf(const V8& v) {
  return ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7]));
}

}  // namespace

}  // namespace cairn::direct
