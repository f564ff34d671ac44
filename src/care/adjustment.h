// Adjusts what is left of a map after a change that took something out of it.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "base/status.h"
#include "map/delta.h"
#include "map/snapshot.h"

namespace cairn::care {

struct AdjustedChange {
  map::Delta delta;  // the change, with the adjustment that follows it, as one change of `base`
  std::int64_t keyframes = 0;
  double rmse_px = 0.0;       // of whitened residuals, after it; of several components the largest
  std::vector<double> moves;  // of the camera centres, as shares of the median depth of what they see
};

// `change`, and after it the bundle adjustment of the components named; what cannot be adjusted (fewer than two
// keyframes that share points, a solver that fails) stays as `change` left it. Components that are aligned to the world
// stay where they are there: the similarity that takes the adjusted cameras back to where they were is applied.
absl::StatusOr<AdjustedChange> AdjustAfter(const std::shared_ptr<const map::Snapshot>& base, map::Delta change,
                                           const std::vector<ComponentId>& components);

}  // namespace cairn::care
