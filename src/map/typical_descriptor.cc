#include "map/typical_descriptor.h"

#include <algorithm>
#include <array>

#include "image/hamming.h"

namespace cairn::map {
namespace {

constexpr std::size_t kMostCompared = 24;

}  // namespace

std::size_t MostTypicalDescriptor(std::vector<image::Descriptor>* descriptors) {
  const std::size_t step = (descriptors->size() + kMostCompared - 1) / kMostCompared;
  std::size_t count = 0;
  for (std::size_t i = 0; i < descriptors->size(); i += step) (*descriptors)[count++] = (*descriptors)[i];
  if (count == 1) return 0;
  std::size_t best = 0;
  int best_median = 257;
  std::array<std::uint16_t, kMostCompared> distances;
  for (std::size_t i = 0; i < count; ++i) {
    image::HammingDistances((*descriptors)[i], descriptors->data(), count, distances.data());
    distances[i] = distances[count - 1];  // not to itself
    const auto middle = distances.begin() + (count - 1) / 2;
    std::nth_element(distances.begin(), middle, distances.begin() + (count - 1));
    if (*middle < best_median) {
      best_median = *middle;
      best = i;
    }
  }
  return best * step;
}

}  // namespace cairn::map
