// Statistics of a stream of numbers without end in bounded memory: count, mean, least and greatest are exact;
// percentiles are exact up to `capacity` samples, and from then on those of a uniform random choice of all so far
// (Vitter's algorithm R, ACM TOMS 11, 1985), the same in every run.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/random.h"

namespace cairn {

class SampleReservoir {
 public:
  static constexpr std::size_t kDefaultCapacity = 16384;

  explicit SampleReservoir(std::size_t capacity = kDefaultCapacity) : capacity_(capacity) {}

  void Add(float sample);

  std::int64_t count() const { return count_; }
  bool empty() const { return count_ == 0; }
  // 0 without samples.
  double sum() const { return sum_; }
  double mean() const { return count_ > 0 ? sum_ / static_cast<double>(count_) : 0.0; }
  double min() const { return min_; }
  double max() const { return max_; }
  // The value below which `share` (0 to 1) of the samples lie; 0 without samples.
  double Percentile(double share) const;

  // What is kept: all of them, in order, until there are more than the capacity.
  const std::vector<float>& kept() const { return kept_; }

 private:
  std::size_t capacity_;
  std::vector<float> kept_;
  std::int64_t count_ = 0;
  double sum_ = 0.0;
  float min_ = 0.0f;
  float max_ = 0.0f;
  Random random_{1};
};

}  // namespace cairn
