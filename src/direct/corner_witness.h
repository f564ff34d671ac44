// Whether corners bear out poses that no window and no bundle adjustment does: of the frames before a start's
// reference, which are tracked backwards against it alone. In a blur the image fits its sharp reference about as well a
// pixel beside the true pose, where the odometry sees nothing wrong; followed corners tell, or are lost, and then
// nothing vouches for the pose.
//
// One thread at a time; no lock.
#pragma once

#include <optional>
#include <vector>

#include "direct/feature_start.h"
#include "direct/odometry_options.h"
#include "direct/packet.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::direct {

class CornerWitness {
 public:
  // `camera` is at full resolution. `noise_px` is how badly the start's own corners fit its motion, at full resolution.
  CornerWitness(const OdometryOptions& options, const Pinhole& camera, const Frame& reference, double noise_px);

  // One more frame, the neighbour in time of the one before: false where no corners follow to it, not even ones chosen
  // anew in the frame before, or where they contradict the poses since they were chosen (ExplainsClearlyWorse()). Then
  // it is not asked again.
  bool BearsOut(const Frame& frame, const SE3& camera_from_reference);

 private:
  void FollowFromLast();
  bool Follows(const Frame& frame);

  FeatureStart corners_;
  double noise_px2_;
  Frame last_;  // that was borne out, with its pose
  SE3 last_from_reference_;
  SE3 first_from_reference_;  // of the frame that the corners were chosen in, and of those since against it
  std::vector<std::optional<SE3>> camera_from_first_;
};

}  // namespace cairn::direct
