// What a change of a map costs those who look for themselves in it, told by the map's own keyframes: each is looked for
// before and after, without itself (inspect/coverage.h). The whole image of a keyframe is easily found; halves of it
// are, too, what an image that shows less is like.
#pragma once

#include <functional>

#include "base/status.h"
#include "inspect/coverage.h"
#include "tracking/map_view.h"

namespace cairn::care {

struct QueryCount {
  int views = 0;  // asked for, before and after
  int found_before = 0;
  int found_after = 0;
  int lost = 0;  // found before and not after

  double share_before() const { return views > 0 ? 1.0 * found_before / views : 0.0; }
  double share_after() const { return views > 0 ? 1.0 * found_after / views : 0.0; }
  double loss() const { return share_before() - share_after(); }
  // Of views like these, no larger share is lost with a confidence of 95 %: the upper end of Wilson's interval (JASA
  // 22, 1927) for `lost` of `views`. 1 if there are none.
  double LossAtMost() const;
};

struct SelfQueries {
  QueryCount whole;   // images as keyframes have them
  QueryCount halves;  // the left, right, upper and lower half of each by itself
};

// At most options.max_tests keyframes, spread evenly. A keyframe is taken out alone, whatever options.same_view_share
// is: that others see the same is what a change may end. One that stays, with nine tenths of its points at least, will
// be there for images like its own: what came of it before counts for afterwards, too (without it a map of few
// keyframes would seem worse than it is). `progress` as of MeasureCoverage. FailedPrecondition: there is no vocabulary.
absl::StatusOr<SelfQueries> CompareSelfQueries(const tracking::MapView& before, const tracking::MapView& after,
                                               const inspect::CoverageOptions& options,
                                               const std::function<bool(int, int)>& progress = {});

}  // namespace cairn::care
