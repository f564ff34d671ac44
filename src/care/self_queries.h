// What a change of a map costs those who look for themselves in it, told by the map's own keyframes: each is looked for
// before and after, without itself and those that see the same (inspect/coverage.h).
#pragma once

#include <functional>

#include "base/status.h"
#include "inspect/coverage.h"
#include "tracking/map_view.h"

namespace cairn::care {

struct SelfQueries {
  int views = 0;  // asked for, before and after
  int found_before = 0;
  int found_after = 0;
  double share_before() const { return views > 0 ? 1.0 * found_before / views : 0.0; }
  double share_after() const { return views > 0 ? 1.0 * found_after / views : 0.0; }
};

// At most options.max_tests keyframes, spread evenly. `progress` as of MeasureCoverage. FailedPrecondition: there is no
// vocabulary.
absl::StatusOr<SelfQueries> CompareSelfQueries(const tracking::MapView& before, const tracking::MapView& after,
                                               const inspect::CoverageOptions& options,
                                               const std::function<bool(int, int)>& progress = {});

}  // namespace cairn::care
