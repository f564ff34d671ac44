#include "base/sample_reservoir.h"

#include <algorithm>

namespace cairn {

void SampleReservoir::Add(float sample) {
  min_ = count_ == 0 ? sample : std::min(min_, sample);
  max_ = count_ == 0 ? sample : std::max(max_, sample);
  ++count_;
  sum_ += sample;
  if (kept_.size() < capacity_) {
    kept_.push_back(sample);
    return;
  }
  const std::uint64_t place = random_.Below(static_cast<std::uint64_t>(count_));
  if (place < kept_.size()) kept_[place] = sample;
}

double SampleReservoir::Percentile(double share) const {
  if (kept_.empty()) return 0.0;
  if (share <= 0.0) return min_;
  if (share >= 1.0) return max_;
  std::vector<float> sorted = kept_;
  const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), nth, sorted.end());
  return *nth;
}

}  // namespace cairn
