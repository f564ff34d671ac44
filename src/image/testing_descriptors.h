// Random descriptors for the tests of this folder.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "base/random.h"
#include "image/feature.h"

namespace cairn::place {

inline image::Descriptor RandomDescriptor(Random* random) {
  return {random->Next(), random->Next(), random->Next(), random->Next()};
}

// With `count` different bits flipped.
inline image::Descriptor FlipBits(image::Descriptor descriptor, int count, Random* random) {
  std::array<int, 256> bits;
  for (int i = 0; i < 256; ++i) bits[i] = i;
  for (int i = 0; i < count; ++i) {
    std::swap(bits[i], bits[i + random->Below(256 - i)]);
    descriptor[bits[i] / 64] ^= std::uint64_t{1} << (bits[i] % 64);
  }
  return descriptor;
}

}  // namespace cairn::place
