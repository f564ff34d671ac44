// How much of what a keyframe should see of another part of the map it does see, if a similarity between the two is
// right. Matches alone prove little: rooms with the same furniture, a poster that hangs twice, give hundreds of them
// that agree. What they do not give is the rest of the view: where the similarity is wrong, most points that should be
// seen are not there.
#pragma once

#include <cstddef>
#include <span>

#include "map/snapshot.h"
#include "mapping/grid_cache.h"
#include "tracking/projection_matcher.h"

namespace cairn::mapping {

struct ViewShare {
  std::size_t expected = 0;  // points that should be seen ...
  std::size_t found = 0;     // ... and are

  double value() const { return expected > 0 ? static_cast<double>(found) / static_cast<double>(expected) : 0.0; }
  ViewShare& operator+=(const ViewShare& other) {
    expected += other.expected;
    found += other.found;
    return *this;
  }
};

// `viewer_from_map`: from the frame of `points` to the camera of `viewer`, in the unit of the viewer's own points.
// `matches`: of these points in the viewer by that similarity (tracking::MatchByProjection). Points behind what the
// viewer sees around them (two points of its own or more, all clearly nearer) are not expected.
ViewShare ShareSeen(const map::Snapshot& map, const map::Keyframe& viewer, const Sim3& viewer_from_map,
                    std::span<const map::MapPoint* const> points, const tracking::ProjectionMatches& matches,
                    const image::FeatureGrid& grid);

}  // namespace cairn::mapping
