// Makes a map smaller: keyframes of which others show the same go, and points that are rarely found where they should
// be seen - by the measures by which mapping keeps a map free of clutter (mapping/culling.h), but wherever they are,
// and, where a budget asks for it, further than mapping would go.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>

#include "base/status.h"
#include "care/self_queries.h"
#include "map/delta.h"
#include "map/snapshot.h"
#include "store/map_overview.h"
#include "tracking/map_view.h"

namespace cairn::care {

struct PruneOptions {
  // Keyframes go, the most redundant first, until the file has so many bytes. Without it, as long as one is as
  // redundant as `min_redundancy`: half of that is the mean of the shares of its points that one, two and three others
  // see as well, half the largest share that a single one of them sees.
  std::optional<std::int64_t> budget_bytes;
  double min_redundancy = 0.7;
  bool as_far_as_possible = false;  // what there is instead of an error, if the budget cannot be kept
  int min_keyframes = 3;            // of a component that are left, whatever the budget

  absl::Status Validate() const;
};

struct PrunePlan {
  map::Delta delta;                                  // of the map as it was; empty: nothing is to be pruned
  std::int64_t keyframes = 0, points = 0;            // that go
  std::int64_t keyframes_left = 0, points_left = 0;  // that stay
  std::int64_t bytes_before = 0;                     // of the file as it is
  std::int64_t bytes_after = 0;                      // estimated, once it is compacted (pruning_trial.h: tried)
};

// How many bytes what `map` holds would take in a file of its own, by how much it takes in the one of `overview`, of
// which it is a later state.
std::int64_t PredictBytes(const store::MapOverview& overview, const map::Snapshot& before, const map::Snapshot& map);

// FailedPrecondition if the budget cannot be kept; the message says what can be.
absl::StatusOr<PrunePlan> PlanPruning(const std::shared_ptr<const map::Snapshot>& map,
                                      const store::MapOverview& overview, const PruneOptions& options);

}  // namespace cairn::care
