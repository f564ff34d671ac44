// Summary numbers of a list of errors, and of the same figure over several runs.
#pragma once

#include <span>
#include <vector>

#include "base/status.h"

namespace cairn::eval {

struct Statistics {
  int count = 0;
  double rmse = 0.0;
  double mean = 0.0;
  double median = 0.0;   // the mean of the middle two for an even count
  double std_dev = 0.0;  // about the mean, divided by count
  double min = 0.0;
  double max = 0.0;
};

// All zero for an empty list.
Statistics Summarize(std::span<const double> values);

// The middle value, the mean of the middle two for an even count, infinite if those are; 0 for an empty list.
double Median(std::vector<double> values);

struct RunSummary {
  int runs = 0;
  int failed = 0;
  double median = 0.0;
  double best = 0.0;
  double worst = 0.0;
};

// A figure (in the unit of `failed_value`) over several runs of one sequence, as the paper reports it: the median over
// all runs, a failed run counting as `failed_value` (10 m for the ATE on EuRoC, infinity for the alignment error on TUM
// monoVO).
RunSummary SummarizeRuns(std::span<const absl::StatusOr<double>> runs, double failed_value);

}  // namespace cairn::eval
