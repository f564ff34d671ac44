#include "cli/sample_statistics.h"

#include <algorithm>

namespace cairn::cli {

double Percentile(std::vector<float> samples, double share) {
  if (samples.empty()) return 0.0;
  const auto nth = static_cast<std::ptrdiff_t>(share * static_cast<double>(samples.size() - 1));
  std::nth_element(samples.begin(), samples.begin() + nth, samples.end());
  return samples[static_cast<std::size_t>(nth)];
}

double Mean(const std::vector<float>& samples) {
  double sum = 0.0;
  for (const float sample : samples) sum += sample;
  return samples.empty() ? 0.0 : sum / static_cast<double>(samples.size());
}

nlohmann::ordered_json SampleStatistics(const std::vector<float>& samples) {
  return {{"median", Percentile(samples, 0.5)},
          {"mean", Mean(samples)},
          {"p99", Percentile(samples, 0.99)},
          {"max", Percentile(samples, 1.0)}};
}

}  // namespace cairn::cli
