// How much of what a keyframe should see of another part of the map it does see, if a similarity between the two is
// right. Matches alone prove little: rooms with the same furniture, a poster that hangs twice, give hundreds of them
// that agree. What they do not give is the rest of the view: where the similarity is wrong, nothing of what should be
// seen there is found. Counted are cells of the image and not points: how many points are found again depends on light
// and distance, that there are none in a whole cell does not.
#pragma once

#include <span>

#include "map/snapshot.h"
#include "tracking/projection_matcher.h"

namespace cairn::mapping {

struct ViewShare {
  int expected = 0;  // cells in which several points should be seen ...
  int seen = 0;      // ... and those in which some are

  double value() const { return expected > 0 ? static_cast<double>(seen) / expected : 0.0; }
  ViewShare& operator+=(const ViewShare& other) {
    expected += other.expected;
    seen += other.seen;
    return *this;
  }
};

// `viewer_from_map`: from the frame of `points` to the camera of `viewer`, in the unit of the viewer's own points.
// `matches`: of these points in the viewer by that similarity (tracking::MatchByProjection). Of those that are not
// found only such count as the viewer could see: around them it sees points of its own, and not all are clearly nearer.
ViewShare ShareSeen(const map::Snapshot& map, const map::Keyframe& viewer, const Sim3& viewer_from_map,
                    std::span<const map::MapPoint* const> points, const tracking::ProjectionMatches& matches,
                    const image::FeatureGrid& grid);

}  // namespace cairn::mapping
