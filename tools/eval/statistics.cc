#include "eval/statistics.h"

#include <algorithm>
#include <cmath>

namespace cairn::eval {

double Median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  std::sort(values.begin(), values.end());
  const std::size_t middle = values.size() / 2;
  if (values.size() % 2 == 1 || values[middle - 1] == values[middle]) return values[middle];
  return 0.5 * (values[middle - 1] + values[middle]);
}

Statistics Summarize(std::span<const double> values) {
  Statistics s;
  if (values.empty()) return s;
  s.count = static_cast<int>(values.size());
  const double n = static_cast<double>(values.size());
  double sum = 0.0, sum_squares = 0.0;
  for (const double v : values) {
    sum += v;
    sum_squares += v * v;
  }
  s.mean = sum / n;
  s.rmse = std::sqrt(sum_squares / n);
  double spread = 0.0;
  for (const double v : values) spread += (v - s.mean) * (v - s.mean);
  s.std_dev = std::sqrt(spread / n);
  s.median = Median({values.begin(), values.end()});
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  s.min = *low;
  s.max = *high;
  return s;
}

RunSummary SummarizeRuns(std::span<const absl::StatusOr<double>> runs, double failed_value) {
  RunSummary summary;
  std::vector<double> values;
  for (const auto& run : runs) {
    ++summary.runs;
    if (!run.ok()) ++summary.failed;
    values.push_back(run.ok() ? *run : failed_value);
  }
  if (values.empty()) return summary;
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  summary.best = *low;
  summary.worst = *high;
  summary.median = Median(std::move(values));
  return summary;
}

}  // namespace cairn::eval
