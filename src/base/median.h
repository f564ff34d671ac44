// The middle of some numbers.
#pragma once

#include <algorithm>
#include <vector>

namespace cairn {

// The upper one of the two in the middle if their count is even; 0 of none. Takes a copy: it sorts.
inline double Median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace cairn
