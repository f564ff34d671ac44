#include "geometry/pose_association.h"

#include <algorithm>

namespace cairn {

std::vector<StampedPose> SortedFinite(std::span<const StampedPose> poses) {
  std::vector<StampedPose> sorted;
  for (const StampedPose& pose : poses) {
    if (pose.world_from_camera.translation().allFinite()) sorted.push_back(pose);
  }
  std::stable_sort(sorted.begin(), sorted.end(),
                   [](const StampedPose& x, const StampedPose& y) { return x.time_ns < y.time_ns; });
  return sorted;
}

std::vector<Association> AssociateNearest(std::span<const StampedPose> estimate,
                                          std::span<const StampedPose> groundtruth, double max_dt_s) {
  std::vector<Association> pairs;
  if (groundtruth.empty()) return pairs;
  const TimeNs max_dt_ns = FromSeconds(max_dt_s);
  for (std::size_t i = 0; i < estimate.size(); ++i) {
    const TimeNs t = estimate[i].time_ns;
    const auto after = std::lower_bound(groundtruth.begin(), groundtruth.end(), t,
                                        [](const StampedPose& pose, TimeNs time) { return pose.time_ns < time; });
    auto nearest = after;
    if (after == groundtruth.end() ||
        (after != groundtruth.begin() && t - (after - 1)->time_ns <= after->time_ns - t)) {
      nearest = after - 1;
    }
    if (std::abs(nearest->time_ns - t) > max_dt_ns) continue;
    pairs.push_back({i, static_cast<std::size_t>(nearest - groundtruth.begin())});
  }
  return pairs;
}

PairedPoses PosesOf(std::span<const StampedPose> estimate, std::span<const StampedPose> groundtruth,
                    std::span<const Association> pairs) {
  PairedPoses poses;
  for (const Association& pair : pairs) {
    poses.estimate.push_back(estimate[pair.estimate].world_from_camera);
    poses.groundtruth.push_back(groundtruth[pair.groundtruth].world_from_camera);
  }
  return poses;
}

}  // namespace cairn
