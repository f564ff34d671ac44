// Median, mean and percentiles of times, as every verb prints them.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

namespace cairn::cli {

// The value below which `share` (0 to 1) of the samples lie; 0 if there are none.
double Percentile(std::vector<float> samples, double share);
double Mean(const std::vector<float>& samples);
// {"median", "mean", "p99", "max"}.
nlohmann::ordered_json SampleStatistics(const std::vector<float>& samples);

}  // namespace cairn::cli
