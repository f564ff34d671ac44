// Depths for features from the points of the direct module (Lee and Civera, "Loosely-Coupled Semi-Direct Monocular
// SLAM", RA-L 2019, Sec. V-B): the inverse-variance mean of the inverse depths that project within two pixels of a
// keypoint.
#pragma once

#include <span>
#include <vector>

#include "base/status.h"
#include "direct/packet.h"
#include "image/feature.h"

namespace cairn::mapping {

struct KeypointDepthOptions {
  double radius_px = 2.0;              // by which a projection is dilated
  double radius_growth = 1.0;          // times this per octave of the keypoint, whose place is the less certain
  double max_relative_sigma = 0.0317;  // of the mean: sigma over inverse depth (a relative variance of 0.001)
  double max_relative_spread = 0.15;   // points that differ by more lie on both sides of an edge: no depth

  absl::Status Validate() const;
};

// For a start that has too few: soft images have their corners in the higher octaves, and the points that the odometry
// chose elsewhere on the same edges.
inline KeypointDepthOptions WideKeypointDepths(double scale_factor) {
  return {.radius_px = 3.0, .radius_growth = scale_factor};
}

struct KeypointDepth {
  double inverse_depth = 0.0;  // 1 / z in the keyframe, in the units of the points; 0: unknown
  double variance = 0.0;

  bool known() const { return inverse_depth > 0.0; }
};

// One per keypoint. Points without positive finite inverse depth and variance are passed over.
std::vector<KeypointDepth> KeypointDepths(std::span<const image::Keypoint> keypoints,
                                          std::span<const direct::PacketPoint> points,
                                          const KeypointDepthOptions& options = {});

}  // namespace cairn::mapping
