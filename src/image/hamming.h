// Hamming distances of one descriptor to many: the inner loop of matching and of the vocabulary.
#pragma once

#include <cstddef>
#include <cstdint>

#include "image/feature.h"

namespace cairn::image {

// distances[i] = HammingDistance(query, descriptors[i]) for i < count. With AVX2 where the processor has it; the
// results are the same everywhere.
void HammingDistances(const Descriptor& query, const Descriptor* descriptors, std::size_t count,
                      std::uint16_t* distances);

// distances[i] = HammingDistance(query, descriptors[indices[i]]) for i < count.
void HammingDistancesAt(const Descriptor& query, const Descriptor* descriptors, const std::uint32_t* indices,
                        std::size_t count, std::uint16_t* distances);

namespace internal {
// The same on plain words (four per descriptor), without and with AVX2.
void HammingDistancesPortable(const std::uint64_t* query, const std::uint64_t* descriptors, std::size_t count,
                              std::uint16_t* distances);
void HammingDistancesAvx2(const std::uint64_t* query, const std::uint64_t* descriptors, std::size_t count,
                          std::uint16_t* distances);
void HammingDistancesAtPortable(const std::uint64_t* query, const std::uint64_t* descriptors,
                                const std::uint32_t* indices, std::size_t count, std::uint16_t* distances);
void HammingDistancesAtAvx2(const std::uint64_t* query, const std::uint64_t* descriptors, const std::uint32_t* indices,
                            std::size_t count, std::uint16_t* distances);
}  // namespace internal

}  // namespace cairn::image
