// Bundle adjustment of a whole component, apart from the map: computed from a Snapshot, perhaps in another thread and
// for long, and then merged into what the map has become meanwhile (Mur-Artal, Tardos, "ORB-SLAM2", T-RO 2017, Sec.
// III-E: keyframes that arrived since follow their parents in the spanning tree, points their reference keyframes). A
// large one is merged in parts, each a change of its own, so that nobody waits for all of it.
#pragma once

#include <atomic>
#include <cstddef>
#include <unordered_map>
#include <unordered_set>
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

// Brings an adjustment into later states of the same map, part by part. After each part the map is a good one: what is
// merged stands where the adjustment puts it, the rest where it stood, and what lies between is as well linked as
// before. Keyframes and points that are gone are passed over.
class AdjustmentMerge {
 public:
  // A part of so many is made in 18 ms and stored in as many (`cairn bench adjustment`, docs/benchmarks.md).
  static constexpr std::size_t kPointsPerPart = 8000;

  explicit AdjustmentMerge(FullAdjustment adjustment);

  // The next keyframes, in the order of their ids, with what hangs on them, until `max_points` points have moved.
  void MergeNext(map::Edit& edit, std::size_t max_points);
  bool done() const { return next_ == order_.size() && adjustment_.positions.empty(); }

 private:
  void MoveKeyframe(KeyframeId id, const SE3& camera_from_map, map::Edit& edit);
  void MovePoints(const map::Keyframe& keyframe, const SE3& camera_from_map, map::Edit& edit);
  bool IsMerged(PointId id) const { return id.value() < merged_.size() && merged_[id.value()]; }
  void DropRejected(KeyframeId id, map::Edit& edit) const;

  FullAdjustment adjustment_;  // positions: of points that are not merged yet; rejected: by keyframe
  std::vector<KeyframeId> order_;
  std::size_t next_ = 0;
  std::unordered_set<KeyframeId> followed_;  // were not adjusted, and have been moved with a parent
  std::vector<bool> merged_;                 // by id: points that stand where they were adjusted to
  std::size_t points_moved_ = 0;             // of this part
};

// All of it as one change.
void MergeFullAdjustment(FullAdjustment adjustment, map::Edit& edit);

}  // namespace cairn::mapping
