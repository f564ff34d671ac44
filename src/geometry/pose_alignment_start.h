// Where geometry/pose_alignment.h begins: answers that up to half of the pairs may contradict.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/status.h"
#include "geometry/pose_alignment_model.h"
#include "geometry/se3.h"

namespace cairn {

struct PoseAlignmentStartOptions {
  bool with_scale = true;
  int max_samples = 500;
  std::uint64_t seed = 1;
};

// The rotation with the smallest median angle to all, then the mean of those near it. At least one.
Quaterniond VotedRotation(std::span<const Quaterniond> rotations);

// Rotation from the orientations, with the mount as given; scale and centre by least median of squares over samples of
// two pairs.
PoseAlignmentState StartFromOrientations(std::span<const SE3> poses_a, std::span<const SE3> poses_b,
                                         const Quaterniond& camera_from_body, const PoseAlignmentStartOptions& options);

// From positions alone (AlignPointsRobust, whose errors it gives); of the rotations about a line the smallest. The
// mount is voted for with this rotation, if asked for.
absl::StatusOr<PoseAlignmentState> StartFromPositions(std::span<const SE3> poses_a, std::span<const SE3> poses_b,
                                                      bool with_mount, const PoseAlignmentStartOptions& options);

}  // namespace cairn
