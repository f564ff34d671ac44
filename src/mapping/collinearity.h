// Which of the two keyframe trajectories to report, the direct module's or the refined one (Lee and Civera,
// "Loosely-Coupled Semi-Direct Monocular SLAM", RA-L 2019, Sec. V-E): feature mapping helps where cameras see the same
// points from many sides, and drifts more where the camera only moves ahead.
#pragma once

#include <span>
#include <string>
#include <unordered_set>

#include "base/status.h"
#include "map/snapshot.h"

namespace cairn::mapping {

struct CollinearityOptions {
  int min_shared_points = 100;  // of a covisibility link that counts
  double min_angle_deg = 30.0;  // two links at an angle between this and 180 degrees less this are not collinear
  double max_collinear_share = 0.25;
  int first_keyframes = 10;  // these count as not collinear: a map that has just begun is always a line

  absl::Status Validate() const;
};

// True if no two of the links from `centre` make an angle in [min, 180 - min] degrees; also with fewer than two links.
bool LinksAreCollinear(const Vector3d& centre, std::span<const Vector3d> neighbour_centres,
                       double min_angle_deg = 30.0);

struct TrajectoryChoice {
  bool refined = false;
  int keyframes = 0;
  int collinear = 0;
  double collinear_share = 0.0;
  std::string reason;  // for people
};

// Keeps count over a session: a keyframe once found not collinear stays so.
class CollinearityCounter {
 public:
  explicit CollinearityCounter(const CollinearityOptions& options = {}) : options_(options) {}

  // Looks at this keyframe of `map`, and again at those linked to it. Keyframes that have left the map keep their
  // verdict.
  void Update(const map::Snapshot& map, KeyframeId keyframe);

  // `lens_corrected`: the map was made with another lens than the direct module's (mapping/lens_refinement.h).
  TrajectoryChoice Choose(bool loop_closed, bool lens_corrected = false) const;

 private:
  bool IsCollinear(const map::Snapshot& map, const map::Keyframe& keyframe) const;

  CollinearityOptions options_;
  int keyframes_ = 0;
  std::unordered_set<KeyframeId> collinear_;
};

}  // namespace cairn::mapping
