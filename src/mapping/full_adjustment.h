// Bundle adjustment of a whole component, apart from the map: computed from a Snapshot, perhaps in another thread and
// for long, and then merged into what the map has become meanwhile (Mur-Artal, Tardos, "ORB-SLAM2", T-RO 2017, Sec.
// III-E: keyframes that arrived since follow their parents in the spanning tree, points their reference keyframes).
#pragma once

#include <atomic>
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/status.h"
#include "map/edit.h"

namespace cairn::mapping {

struct FullAdjustmentOptions {
  int first_iterations = 5;   // with Huber's loss
  int second_iterations = 8;  // without outliers
  SessionId session;          // whose adjustment it is: what others have made and is aligned stays (mapping/held.h)
  // Looked at after every iteration; may be null.
  const std::atomic<bool>* stop = nullptr;

  absl::Status Validate() const;
};

struct FullAdjustment {
  bool interrupted = false;  // nothing below is of use then
  std::unordered_map<KeyframeId, SE3> camera_from_map;
  std::unordered_map<PointId, Vector3d> positions;
  std::vector<std::pair<PointId, KeyframeId>> rejected;  // observations that turned out wrong
  int observations = 0;
  int iterations = 0;
  double rmse = 0.0;  // of whitened inlier residuals
};

// The root of the spanning tree stays where it is. FailedPrecondition for a component of fewer than two keyframes with
// points; Internal if the solver failed.
absl::StatusOr<FullAdjustment> ComputeFullAdjustment(const map::Snapshot& map, ComponentId component,
                                                     const FullAdjustmentOptions& options = {});

// Brings it into a later state of the same map. Keyframes and points that are gone are passed over.
void MergeFullAdjustment(const FullAdjustment& adjustment, map::Edit& edit);

}  // namespace cairn::mapping
