// Sorting ids that are dense (base/ids.h).
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

namespace cairn {

// Ascending, each once. Marking dense ids sorts faster than sorting; few ids far apart are sorted.
template <class IdType>
void SortUnique(std::vector<IdType>* ids) {
  if (ids->empty()) return;
  const auto [least, greatest] = std::minmax_element(ids->begin(), ids->end());
  const std::uint32_t first = least->value();
  const std::size_t range = greatest->value() - first + std::size_t{1};
  if (range > 64 * ids->size()) {
    std::sort(ids->begin(), ids->end());
    ids->erase(std::unique(ids->begin(), ids->end()), ids->end());
    return;
  }
  std::vector<std::uint8_t> there(range, 0);
  for (const IdType id : *ids) there[id.value() - first] = 1;
  ids->clear();
  for (std::size_t i = 0; i < range; ++i) {
    if (there[i]) ids->push_back(IdType(first + static_cast<std::uint32_t>(i)));
  }
}

}  // namespace cairn
