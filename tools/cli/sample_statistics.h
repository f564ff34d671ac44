// Median, mean and percentiles of times, as every verb prints them.
#pragma once

#include <nlohmann/json.hpp>

#include "base/sample_reservoir.h"

namespace cairn::cli {

// {"median", "mean", "p99", "max"}.
nlohmann::ordered_json SampleStatistics(const SampleReservoir& samples);

}  // namespace cairn::cli
