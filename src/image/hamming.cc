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

}  // namespace internal

void HammingDistances(const Descriptor& query, const Descriptor* descriptors, std::size_t count,
                      std::uint16_t* distances) {
  static_assert(sizeof(Descriptor) == 4 * sizeof(std::uint64_t));
  static const auto kernel =
      ActiveSimdLevel() == SimdLevel::kBaseline ? &internal::HammingDistancesPortable : &internal::HammingDistancesAvx2;
  if (count == 0) return;
  kernel(query.data(), descriptors->data(), count, distances);
}

}  // namespace cairn::image
