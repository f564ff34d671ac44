// Whether given poses belong to their images, told before anything is triangulated by them: features of pairs of images
// are matched by their descriptors alone, and a match fits the poses if some point in front of both cameras is seen in
// the two directions. Poses of other images, or camera_from_world taken for world_from_camera, fit no more matches than
// chance does; gates on the epipolar lines of such poses would find "matches" that fit them well.
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "image/feature.h"

namespace cairn::mapping {

struct PoseCheckOptions {
  // Directions may be off by this: the noise of poses and of the calibration. A constant error of the orientation, as
  // of a camera against its body, counts by how much it changes between two views.
  double tolerance_deg = 1.0;
  int min_matches_per_pair = 15;  // fewer are taken for accidents
};

struct PosedFeatures {
  const image::Features* features = nullptr;
  SE3 world_from_camera;
};

struct PoseCheck {
  int pairs = 0;    // with enough matches
  int matches = 0;  // in them
  // Shares of the matches that the poses explain, beyond those that fit by accident: 1 all, 0 none but these.
  double share = 0.0;
  double inverted_share = 0.0;  // if each pose is taken as its inverse
};

// `pairs`: indices of views that may see the same.
PoseCheck CheckPoses(std::span<const PosedFeatures> views, std::span<const std::pair<std::size_t, std::size_t>> pairs,
                     const Pinhole& pinhole, const PoseCheckOptions& options = {});

}  // namespace cairn::mapping
