// Compiled for AVX2, which brings the population count instruction. Plain pointers and built-ins only: an inline
// function of a shared header compiled here could end up in programs for processors without it.
//
// Of eight descriptors four are counted by that instruction and four by looking up the counts of half bytes (W. Mula,
// N. Kurz, D. Lemire, "Faster population counts using AVX2 instructions", 2018): the two keep different execution units
// busy, and together are twice as fast as either alone.
#include <immintrin.h>

#include <cstddef>
#include <cstdint>

namespace cairn::image::internal {
namespace {

struct Query {
  std::uint64_t word[4];
  __m256i all;
};

inline Query Load(const std::uint64_t* query) {
  return {{query[0], query[1], query[2], query[3]}, _mm256_loadu_si256(reinterpret_cast<const __m256i*>(query))};
}

inline std::uint16_t Distance(const Query& q, const std::uint64_t* d) {
  return static_cast<std::uint16_t>(__builtin_popcountll(q.word[0] ^ d[0]) + __builtin_popcountll(q.word[1] ^ d[1]) +
                                    __builtin_popcountll(q.word[2] ^ d[2]) + __builtin_popcountll(q.word[3] ^ d[3]));
}

// The distance in four parts, one in each 64-bit lane.
inline __m256i DistanceParts(const Query& q, const std::uint64_t* d) {
  const __m256i counts = _mm256_setr_epi8(0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4,  //
                                          0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4);
  const __m256i half_byte = _mm256_set1_epi8(15);
  const __m256i x = _mm256_xor_si256(q.all, _mm256_loadu_si256(reinterpret_cast<const __m256i*>(d)));
  const __m256i low = _mm256_shuffle_epi8(counts, _mm256_and_si256(x, half_byte));
  const __m256i high = _mm256_shuffle_epi8(counts, _mm256_and_si256(_mm256_srli_epi16(x, 4), half_byte));
  return _mm256_sad_epu8(_mm256_add_epi8(low, high), _mm256_setzero_si256());
}

inline void FourDistances(const Query& q, const std::uint64_t* a, const std::uint64_t* b, const std::uint64_t* c,
                          const std::uint64_t* d, std::uint16_t* distances) {
  // A part is at most 64: those of four descriptors fit beside each other in 64 bits, and so do their sums.
  const __m256i ab = _mm256_or_si256(DistanceParts(q, a), _mm256_slli_epi64(DistanceParts(q, b), 16));
  const __m256i cd = _mm256_or_si256(DistanceParts(q, c), _mm256_slli_epi64(DistanceParts(q, d), 16));
  const __m256i parts = _mm256_or_si256(ab, _mm256_slli_epi64(cd, 32));
  const __m128i sum = _mm_add_epi16(_mm256_castsi256_si128(parts), _mm256_extracti128_si256(parts, 1));
  _mm_storel_epi64(reinterpret_cast<__m128i*>(distances), _mm_add_epi16(sum, _mm_unpackhi_epi64(sum, sum)));
}

// `at(i)` points to the i-th descriptor.
template <class At>
inline void Distances(const std::uint64_t* query, const At& at, std::size_t count, std::uint16_t* distances) {
  const Query q = Load(query);
  std::size_t i = 0;
  for (; i + 8 <= count; i += 8) {
    FourDistances(q, at(i), at(i + 1), at(i + 2), at(i + 3), distances + i);
    for (std::size_t k = i + 4; k < i + 8; ++k) distances[k] = Distance(q, at(k));
  }
  for (; i < count; ++i) distances[i] = Distance(q, at(i));
}

}  // namespace

void HammingDistancesAvx2(const std::uint64_t* query, const std::uint64_t* descriptors, std::size_t count,
                          std::uint16_t* distances) {
  Distances(
      query, [=](std::size_t i) { return descriptors + 4 * i; }, count, distances);
}

void HammingDistancesAtAvx2(const std::uint64_t* query, const std::uint64_t* descriptors, const std::uint32_t* indices,
                            std::size_t count, std::uint16_t* distances) {
  Distances(
      query, [=](std::size_t i) { return descriptors + 4 * static_cast<std::size_t>(indices[i]); }, count, distances);
}

}  // namespace cairn::image::internal
