// The pose in the map of each frame, from the last frame that was matched against the map (the anchor) and the direct
// motion since:
//
//   map_from_camera(t) = map_from_camera(a) * Scaled(a_from_t, map_per_direct)
//
// The anchor's pose is not that of the match alone: between two matches the odometry errs less than a match does from
// one image to the next, so that the pose that was carried there counts, too, by a Kalman gain of one number: both err
// mostly along the directions that the view leaves weak, where a shift looks like a turn, and a pose between the two by
// one number for all directions keeps to what the images show.
//
// How sure a pose is: the covariance of a pose has three parts: what the matches of the anchor leave open; what the
// odometry may have erred since, in proportion to the way and the turn, and so growing while the map is not matched;
// and the map's own error there, in proportion to the depth of the scene, which no number of matches takes away.
#pragma once

#include "base/status.h"
#include "base/time.h"
#include "client/map_matcher.h"
#include "direct/packet.h"
#include "geometry/se3.h"
#include "tracking/map_error.h"

namespace cairn::client {

struct DriftOptions {
  // Standard deviation of the odometry, per axis: as share of the way and of the turn since the anchor, ...
  double way_share = 0.0075;
  double turn_share = 0.006;
  // ... and in any case, as share of the median depth, and in rad.
  double depth_share = 0.0005;
  double rotation_rad = 0.00025;
  // Of a match by itself, from one to the next, as share of the median depth and in rad; more where few points are
  // seen.
  double match_noise = 0.00075;
  // What a frame that the image did not show, but the motion before, counts more.
  double blind_factor = 20.0;
  tracking::MapErrorOptions map;

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
  // Of what the map does not err itself: (translation / median depth)^2 + (angle in rad)^2.
  double noise_variance = 0.0;
};

// Standard deviations per axis of the motion between the anchor and a frame.
struct MotionSigma {
  double translation = 0.0;  // map units
  double rotation_rad = 0.0;
};
// `drift` is Drift::factor(), times which the odometry of this recording errs more.
MotionSigma SigmaSince(const Anchor& anchor, const Odometer& now, const DriftOptions& options, double drift = 1.0);

// How much more the odometry errs in this recording than DriftOptions says: a good camera in good light drifts less, a
// rolling shutter more. Learnt from how far matches lie from what was carried on.
class Drift {
 public:
  double factor() const;
  // `surprise`: the square of that over what was expected of it.
  void Learn(double surprise);

 private:
  double variance_ = 1.0;  // of the odometry over what the options say
};

// The variance of a match by itself, as Anchor::noise_variance.
double MatchVariance(int inliers, const DriftOptions& options);

// `match` is an anchor as the match leaves it, `carried` the pose that the anchor before was carried on to in its
// frame, `motion` the sigmas of that way: the anchor between the two. A match further from it than both allow stands
// alone. Returns the surprise, for Drift.
double Blend(const Anchor& before, const SE3& carried, const MotionSigma& motion, Anchor* match);

// Of (translation, rotation) as a left increment of `map_from_camera`: the anchor's, the motion's since, and the map's.
Matrix6d CovarianceOf(const Anchor& anchor, const SE3& map_from_camera, const MotionSigma& motion,
                      const DriftOptions& options);

}  // namespace cairn::client
