// The bundle adjustment problem of a part of the map in an Edit, and its way back.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "map/edit.h"
#include "mapping/local_adjustment.h"
#include "optimization/bundle_adjustment.h"

namespace cairn::mapping {

struct AdjustmentProblem {
  optimization::BundleProblem problem;
  std::vector<KeyframeId> keyframes;         // per pose: the free ones, then those that hold their points in place
  std::vector<PointId> points;               // per point
  std::vector<CameraId> cameras;             // per camera
  std::optional<std::uint32_t> only_anchor;  // the pose that alone holds the problem: its scale is free
};

// Of `options` only what says which keyframes are fixed, the priors and the rotations.
AdjustmentProblem BuildAdjustmentProblem(const map::Edit& edit, std::span<const KeyframeId> free,
                                         const LocalAdjustmentOptions& options);

// Nothing in the images tells the scale of a map that hangs on one pose: it may have wandered in what an adjustment
// made of the problem, and others keep lengths in it. The distances of the points from the anchor's camera become, in
// the middle, what they were. Does nothing where more holds the problem.
void KeepScale(const AdjustmentProblem& built, std::vector<SE3>* camera_from_map, std::vector<Vector3d>* points);

}  // namespace cairn::mapping
