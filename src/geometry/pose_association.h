// Which pose of a reference belongs to which estimated pose, by their times.
#pragma once

#include <span>
#include <vector>

#include "geometry/stamped_pose.h"

namespace cairn {

// Sorted by time, without poses whose position is not finite (how files mark "no ground truth here").
std::vector<StampedPose> SortedFinite(std::span<const StampedPose> poses);

struct Association {
  std::size_t estimate = 0;     // index into the estimate
  std::size_t groundtruth = 0;  // index into the ground truth
};

// For each estimated pose the nearest ground truth in time, no interpolation, the earlier one of two equally near; none
// if it is further than max_dt_s. Both sorted by time.
std::vector<Association> AssociateNearest(std::span<const StampedPose> estimate,
                                          std::span<const StampedPose> groundtruth, double max_dt_s);

// The poses of associated pairs, as geometry/pose_alignment.h takes them.
struct PairedPoses {
  std::vector<SE3> estimate, groundtruth;
};
PairedPoses PosesOf(std::span<const StampedPose> estimate, std::span<const StampedPose> groundtruth,
                    std::span<const Association> pairs);

}  // namespace cairn
