// What a map that is pruned takes on the disk, found out on a copy: how full the pages of a file are, and what is kept
// ready for readers, no sum over keyframes and points tells to a percent.
#pragma once

#include <memory>
#include <string>

#include "care/pruning.h"

namespace cairn::care {

// PlanPruning for the newest revision `map` of the map at `path`, with the bytes that the file will have once it is
// changed and compacted. With a budget as many keyframes stay as it allows, to half a percent. Copies the map to a
// file beside it, at most a handful of times, and needs as much free disk as two copies take; others may read and
// write meanwhile. FailedPrecondition as PlanPruning; kFull.
absl::StatusOr<PrunePlan> TryPruning(const std::string& path, const std::shared_ptr<const map::Snapshot>& map,
                                     const PruneOptions& options);

}  // namespace cairn::care
