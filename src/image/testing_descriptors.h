// Random descriptors for tests.
#pragma once

#include <array>
#include <cstdint>
#include <utility>

#include "base/random.h"
#include "image/feature.h"

namespace cairn::image::testing {

inline Descriptor RandomDescriptor(Random& random) {
  return {random.Next(), random.Next(), random.Next(), random.Next()};
}

// With `count` different bits flipped.
inline Descriptor FlipBits(Descriptor descriptor, int count, Random& random) {
  std::array<int, 256> bits;
  for (int i = 0; i < 256; ++i) bits[i] = i;
  for (int i = 0; i < count; ++i) {
    std::swap(bits[i], bits[i + random.Below(256 - i)]);
    descriptor[bits[i] / 64] ^= std::uint64_t{1} << (bits[i] % 64);
  }
  return descriptor;
}

}  // namespace cairn::image::testing
