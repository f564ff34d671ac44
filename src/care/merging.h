// Makes one map of two. The second one's components are put beside the first one's, and each of their keyframes is
// looked for there, as those of a session that does not know where it is: what is proven to overlap - as strictly as
// for a session (mapping/component_join.h) - is joined, points of both sides become one all along the overlap, and the
// joined component is adjusted.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"
#include "mapping/component_join.h"
#include "place/vocabulary.h"

namespace cairn::care {

struct MergeOptions {
  mapping::JoinOptions join;
  bool allow_apart = false;  // also if nothing overlaps: the components stay beside each other
};

// What came of the keyframes of one component of the second map.
struct MergeAttempt {
  ComponentId component;       // as the second map calls it
  std::int64_t keyframes = 0;  // looked for, ...
  std::int64_t seen = 0;       // ... and found in another component
  // The one that came furthest: the component that it was found in (as the merged map calls it), how many of those
  // found lately agreed, and why that was not enough.
  ComponentId nearest;
  int sightings_agreeing = 0, sightings_checked = 0;
  int neighbours_agreeing = 0, neighbours_checked = 0;
  std::map<std::string, int> rejected;  // reasons, and how often
  // If it was joined: to this component of the first map.
  ComponentId joined_into;
  double scale = 1.0;    // by which its lengths have grown
  int fused_points = 0;  // points of both that became one
};

struct Merged {
  std::shared_ptr<const map::Snapshot> map;  // null: nothing overlaps
  std::vector<MergeAttempt> attempts;        // per component of the second map
  std::int64_t adjusted_keyframes = 0;
  double adjustment_rmse_px = 0.0;
};

// `words`: the vocabulary of the first map. `progress` as of MeasureCoverage; false ends it: Cancelled.
// `wall_clock_ns`: of the joins. FailedPrecondition: a map has no keyframes, the first no vocabulary; the two are
// copies of one map, or their features cannot be compared.
absl::StatusOr<Merged> MergeMaps(const std::shared_ptr<const map::Snapshot>& first, const map::Snapshot& second,
                                 const std::shared_ptr<const place::Vocabulary>& words, const MergeOptions& options,
                                 std::int64_t wall_clock_ns, const std::function<bool(int, int)>& progress = {});

}  // namespace cairn::care
