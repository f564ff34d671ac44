// Refines the pose of one keyframe against the map: local map, matching by projection, motion-only bundle adjustment,
// in two rounds
// - wide with the seed pose, then narrow with the refined one over everything that should be seen from there. The local
// map holds the keyframes that share points and their neighbours (Lee and Civera, RA-L 2019, Sec. V-C), and also those
// that merely look from nearby in a similar direction, as long as the way to them through the map is so short that
// drift cannot matter: so a camera that returns soon finds its old points. To return after a long way is a loop
// (mapping/loop_closer.h).
#pragma once

#include <span>
#include <vector>

#include "geometry/pinhole.h"
#include "map/snapshot.h"
#include "mapping/feature_mapper_options.h"
#include "tracking/projection_matcher.h"

namespace cairn::mapping {

struct TrackedKeyframe {
  bool tracked = false;  // enough inliers; otherwise the pose is the seed
  SE3 camera_from_map;
  std::vector<PointId> points;     // per feature: the point it observes (inliers only), or none
  std::vector<PointId> visible;    // points that should be seen, ascending; the inliers are among them
  KeyframeId reference;            // that shares most of the inliers
  std::vector<KeyframeId> nearby;  // by pose only, nearest first
  double median_depth = 0.0;       // z of the inliers in the camera, map units
  int matches = 0;
  int inliers = 0;
};

// Of `among`, those whose camera is within `max_distance` and looks at most `max_angle_deg` away, at most `max_count`,
// best first.
std::vector<KeyframeId> NearbyKeyframes(const map::Snapshot& map, std::span<const KeyframeId> among,
                                        const SE3& camera_from_map, double max_distance, double max_angle_deg,
                                        std::size_t max_count);

// The seed, and how far it may be wrong per axis: what odometry says between two keyframes is worth more than a few
// matches.
struct PoseSeed {
  SE3 camera_from_map;
  double translation_sigma = 0.0;  // map units; 0: the seed is only where the search starts
  double rotation_sigma_rad = 0.0;
};

// `seen`: points that the keyframe before observed. `anchor`: a keyframe to look around in any case (may be none).
// `median_depth`: of the scene there, map units. `radius_factor` widens the first round (after a loss).
TrackedKeyframe TrackKeyframe(const map::Snapshot& map, const tracking::FeatureView& view, const PoseSeed& seed,
                              std::span<const PointId> seen, KeyframeId anchor, double median_depth,
                              double radius_factor, const FeatureMapperOptions& options);

}  // namespace cairn::mapping
