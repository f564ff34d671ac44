#include "image/hamming.h"

#include "base/cpu_features.h"

namespace cairn::image {

namespace internal {

void HammingDistancesPortable(const std::uint64_t* query, const std::uint64_t* descriptors, std::size_t count,
                              std::uint16_t* distances) {
  const Descriptor q = {query[0], query[1], query[2], query[3]};
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint64_t* d = descriptors + 4 * i;
    distances[i] = static_cast<std::uint16_t>(HammingDistance(q, {d[0], d[1], d[2], d[3]}));
  }
}

void HammingDistancesAtPortable(const std::uint64_t* query, const std::uint64_t* descriptors,
                                const std::uint32_t* indices, std::size_t count, std::uint16_t* distances) {
  for (std::size_t i = 0; i < count; ++i) {
    HammingDistancesPortable(query, descriptors + 4 * static_cast<std::size_t>(indices[i]), 1, distances + i);
  }
}

}  // namespace internal

void HammingDistances(const Descriptor& query, const Descriptor* descriptors, std::size_t count,
                      std::uint16_t* distances) {
  static_assert(sizeof(Descriptor) == 4 * sizeof(std::uint64_t));
  static const auto kernel =
      ActiveSimdLevel() == SimdLevel::kBaseline ? &internal::HammingDistancesPortable : &internal::HammingDistancesAvx2;
  if (count == 0) return;
  kernel(query.data(), descriptors->data(), count, distances);
}

void HammingDistancesAt(const Descriptor& query, const Descriptor* descriptors, const std::uint32_t* indices,
                        std::size_t count, std::uint16_t* distances) {
  static const auto kernel = ActiveSimdLevel() == SimdLevel::kBaseline ? &internal::HammingDistancesAtPortable
                                                                       : &internal::HammingDistancesAtAvx2;
  if (count == 0) return;
  kernel(query.data(), descriptors->data(), indices, count, distances);
}

}  // namespace cairn::image
