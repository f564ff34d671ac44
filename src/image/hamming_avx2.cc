// Compiled for AVX2, which brings the population count instruction. Plain pointers and built-ins only: an inline
// function of a shared header compiled here could end up in programs for processors without it.
#include <cstddef>
#include <cstdint>

namespace cairn::image::internal {

void HammingDistancesAvx2(const std::uint64_t* query, const std::uint64_t* descriptors, std::size_t count,
                          std::uint16_t* distances) {
  const std::uint64_t q0 = query[0], q1 = query[1], q2 = query[2], q3 = query[3];
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t* d = descriptors + 4 * i;
    distances[i] = static_cast<std::uint16_t>(__builtin_popcountll(q0 ^ d[0]) + __builtin_popcountll(q1 ^ d[1]) +
                                              __builtin_popcountll(q2 ^ d[2]) + __builtin_popcountll(q3 ^ d[3]));
  }
}

void HammingDistancesAtAvx2(const std::uint64_t* query, const std::uint64_t* descriptors, const std::uint32_t* indices,
                            std::size_t count, std::uint16_t* distances) {
  const std::uint64_t q0 = query[0], q1 = query[1], q2 = query[2], q3 = query[3];
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t* d = descriptors + 4 * static_cast<std::size_t>(indices[i]);
    distances[i] = static_cast<std::uint16_t>(__builtin_popcountll(q0 ^ d[0]) + __builtin_popcountll(q1 ^ d[1]) +
                                              __builtin_popcountll(q2 ^ d[2]) + __builtin_popcountll(q3 ^ d[3]));
  }
}

}  // namespace cairn::image::internal
