// Refines the pose of an image against the map where it is known roughly: local map, matching by projection,
// motion-only bundle adjustment, in two rounds: wide with the seed pose, then narrow with the refined one over
// everything that should be seen from there. The local map holds the keyframes that share points and their neighbours
// (Lee and Civera, RA-L 2019, Sec. V-C), and also those that merely look from nearby in a similar direction, as long as
// the way to them through the map is so short that drift cannot matter: so a camera that returns soon finds its old
// points. To return after a long way is a loop (mapping/loop_closer.h). Changes nothing in the map; poses and lengths
// are in the frame and unit of the component that is looked around in.
#pragma once

#include <span>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"
#include "tracking/local_point_cache.h"
#include "tracking/projection_matcher.h"

namespace cairn::tracking {

struct LocalMapTrackerOptions {
  int min_inliers = 25;  // fewer: not tracked
  int max_keyframes = 60;
  double search_radius_px = 12.0;         // at octave 0, around a point projected with the seed pose
  double refined_search_radius_px = 4.0;  // and with the refined one
  // Keyframes count as neighbours, linked or not, within this distance (in median scene depths) and viewing angle.
  double neighbour_distance = 0.6;
  double neighbour_angle_deg = 45.0;
  // ... if the way to them along the map's graph is not longer than this, in median scene depths: over a longer one
  // drift shows, and they are left to loop closing.
  double neighbour_way = 5.0;
  // Matches count by how well the map knows their points, too, as seen from the camera (tracking/point_uncertainty.h).
  bool weigh_points = false;

  absl::Status Validate() const;
};

// The seed, and how far it may be wrong per axis: what odometry says between two keyframes is worth more than a few
// matches.
struct PoseSeed {
  SE3 camera_from_map;
  double translation_sigma = 0.0;  // map units; 0: the seed is only where the search starts
  double rotation_sigma_rad = 0.0;
};

// Where the image is thought to be.
struct LocalMapStart {
  PoseSeed seed;
  std::span<const PointId> seen;  // points that the image before observed; may be empty
  KeyframeId anchor;              // to look around in any case; may be none
  double median_depth = 0.0;      // of the scene there, map units
  double radius_factor = 1.0;     // widens the first round (after a loss)
  // The first round looks for `seen` alone if most of them are found: enough, and several times as fast, where the
  // image before was matched and shows nearly the same.
  bool seen_first = false;
  LocalPointCache* cache = nullptr;  // of this map, kept from image to image; may be null
};

struct TrackedView {
  bool tracked = false;  // enough inliers; otherwise the pose is the seed
  SE3 camera_from_map;
  // Of (translation, rotation) as a left increment of camera_from_map, map units and radians, with what the seed's
  // sigmas say; of the refinement only: that the map's points err together is not in it.
  Matrix6d covariance = Matrix6d::Zero();
  std::vector<PointId> points;     // per feature: the point it observes (inliers only), or none
  std::vector<PointId> visible;    // points that should be seen, ascending; the inliers are among them
  KeyframeId reference;            // that shares most of the inliers
  std::vector<KeyframeId> nearby;  // by pose only, nearest first
  double median_depth = 0.0;       // z of the inliers in the camera, map units
  // Root mean square of the inliers' residuals, per coordinate, in units of their keypoints' size: how well image and
  // map agree.
  double residual_rms = 0.0;
  int matches = 0;
  int inliers = 0;
};

TrackedView TrackLocalMap(const map::Snapshot& map, const FeatureView& view, const LocalMapStart& start,
                          const LocalMapTrackerOptions& options);

}  // namespace cairn::tracking
