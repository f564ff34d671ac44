// A part of a map as a map of its own.
#pragma once

#include <functional>
#include <memory>

#include "base/status.h"
#include "map/snapshot.h"

namespace cairn::care {

// The keyframes that `keep` says, the points that they see, and what these refer to: components (with the history of
// those that were joined to them, if sessions of both sides are there), sessions that have keyframes, cameras. Ids
// stay. What hung together still does, in one tree per component. `info`: of the map to be, at revision 1.
// FailedPrecondition if nothing is kept.
absl::StatusOr<std::shared_ptr<const map::Snapshot>> SelectKeyframes(
    const map::Snapshot& map, const map::MapInfo& info, const std::function<bool(const map::Keyframe&)>& keep);

}  // namespace cairn::care
