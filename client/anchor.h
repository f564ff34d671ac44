// The pose in the map of each frame, from the last frame that was matched against the map (the anchor) and the direct
// motion since:
//
//   map_from_camera(t) = map_from_camera(a) * Scaled(a_from_t, map_per_direct)
//
// and how sure that is. The covariance of a pose has three parts: what the matches of the anchor leave open; what the
// odometry may have erred since, in proportion to the way and the turn, and so growing while the map is not matched;
// and the map's own error there, in proportion to the depth of the scene, which no number of matches takes away.
#pragma once

#include "base/status.h"
#include "base/time.h"
#include "client/map_matcher.h"
#include "direct/packet.h"
#include "geometry/se3.h"

namespace cairn::client {

struct DriftOptions {
  // Standard deviation of the odometry, per axis: as share of the way and of the turn since the anchor, ...
  double way_share = 0.015;
  double turn_share = 0.012;
  // ... and in any case, as share of the median depth, and in rad.
  double depth_share = 0.001;
  double rotation_rad = 0.0005;
  // What a frame that the image did not show, but the motion before, counts more.
  double blind_factor = 20.0;
  // Of the map, per axis, times the cube of Anchor::residual_rms, and more where few points are seen: where a
  // map is bent, or its lens or shutter not what the model says, images fit it worse. A measured law, not a derived
  // one: in rendered worlds residuals are half as large as in a recording of a handheld camera with a rolling shutter,
  // and the errors a fifth (docs/benchmarks.md).
  double map_depth_share = 0.0096;
  double map_rotation_rad = 0.0077;

  absl::Status Validate() const;
};

// How far the camera has come, as an odometer counts.
struct Odometer {
  double way = 0.0;  // map units
  double turn_rad = 0.0;

  void Add(const SE3& motion, double factor);
};

// A frame that was matched against the map.
struct Anchor {
  direct::FrameResult direct;  // keyframe -1: the odometry does not know it
  Place place;
  Matrix6d covariance = Matrix6d::Zero();  // as Sighting::covariance
  TimeNs time_ns = 0;
  int inliers = 0;
  double residual_rms = 1.0;  // tracking::TrackedView::residual_rms
  Odometer odometer;          // at that frame
};

// Standard deviations per axis of the motion between the anchor and a frame.
struct MotionSigma {
  double translation = 0.0;  // map units
  double rotation_rad = 0.0;
};
MotionSigma SigmaSince(const Anchor& anchor, const Odometer& now, const DriftOptions& options);

// Of (translation, rotation) as a left increment of `map_from_camera`: the anchor's, the motion's since, and the map's.
Matrix6d CovarianceOf(const Anchor& anchor, const SE3& map_from_camera, const MotionSigma& motion,
                      const DriftOptions& options);

}  // namespace cairn::client
