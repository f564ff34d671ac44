#include "api/server_status.h"

#include <algorithm>
#include <numeric>

namespace cairn::api {

std::int64_t DurationHistogram::total() const { return std::accumulate(counts.begin(), counts.end(), std::int64_t{0}); }

double DurationHistogram::Quantile(double share) const {
  const std::int64_t all = total();
  if (all <= 0 || bounds_s.empty()) return 0.0;
  const double wanted = share * static_cast<double>(all);
  double below = 0.0, from = 0.0;
  for (std::size_t i = 0; i < bounds_s.size() && i < counts.size(); ++i) {
    const auto here = static_cast<double>(counts[i]);
    if (here > 0.0 && below + here >= wanted) return from + (bounds_s[i] - from) * std::max(0.0, wanted - below) / here;
    below += here;
    from = bounds_s[i];
  }
  return bounds_s.back();
}

DurationHistogram DurationHistogram::Since(const DurationHistogram& before) const {
  if (before.bounds_s != bounds_s || before.counts.size() != counts.size() || before.total() > total()) return *this;
  DurationHistogram since = *this;
  for (std::size_t i = 0; i < counts.size(); ++i) since.counts[i] -= before.counts[i];
  since.sum_s -= before.sum_s;
  return since;
}

}  // namespace cairn::api
