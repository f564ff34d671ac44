// How many keyframes of a session see the same points from one line only (Lee and Civera, "Loosely-Coupled Semi-Direct
// Monocular SLAM", RA-L 2019, Sec. V-E): kept in the map's file. Which trajectory is reported map_memory.h decides.
#pragma once

#include <span>
#include <unordered_set>

#include "base/status.h"
#include "map/snapshot.h"

namespace cairn::mapping {

struct CollinearityOptions {
  int min_shared_points = 100;  // of a covisibility link that counts
  double min_angle_deg = 30.0;  // two links at an angle between this and 180 degrees less this are not collinear
  int first_keyframes = 10;     // these count as not collinear: a map that has just begun is always a line

  absl::Status Validate() const;
};

// True if no two of the links from `centre` make an angle in [min, 180 - min] degrees; also with fewer than two links.
bool LinksAreCollinear(const Vector3d& centre, std::span<const Vector3d> neighbour_centres,
                       double min_angle_deg = 30.0);

// Keeps count over a session: a keyframe once found not collinear stays so.
class CollinearityCounter {
 public:
  explicit CollinearityCounter(const CollinearityOptions& options = {}) : options_(options) {}

  // Looks at this keyframe of `map`, and again at those linked to it. Keyframes that have left the map keep their
  // verdict.
  void Update(const map::Snapshot& map, KeyframeId keyframe);

  int keyframes() const { return keyframes_; }
  int collinear() const { return static_cast<int>(collinear_.size()); }

 private:
  bool IsCollinear(const map::Snapshot& map, const map::Keyframe& keyframe) const;

  CollinearityOptions options_;
  int keyframes_ = 0;
  std::unordered_set<KeyframeId> collinear_;
};

}  // namespace cairn::mapping
