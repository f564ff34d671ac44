#include "mapping/full_adjustment.h"

#include <algorithm>
#include <limits>

#include "mapping/held.h"
#include "optimization/bundle_adjustment.h"

namespace cairn::mapping {
namespace {

struct Built {
  optimization::BundleProblem problem;
  std::vector<KeyframeId> keyframes;  // per pose
  std::vector<PointId> points;        // per point
};

Built Build(const map::Snapshot& map, ComponentId component, SessionId session) {
  Built built;
  std::unordered_map<CameraId, std::uint32_t> camera_of;
  for (const auto& [id, camera] : map.cameras()) {
    camera_of[id] = static_cast<std::uint32_t>(built.problem.cameras.size());
    built.problem.cameras.push_back(camera.pinhole);
  }
  std::unordered_map<KeyframeId, std::uint32_t> pose_of;
  map.keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    if (keyframe->component != component) return;
    pose_of[keyframe->id] = static_cast<std::uint32_t>(built.keyframes.size());
    built.keyframes.push_back(keyframe->id);
    const bool stays = !keyframe->parent || (session && IsHeld(map, *keyframe, session));
    built.problem.poses.push_back({keyframe->camera_from_map, camera_of.at(keyframe->camera), stays});
  });
  map.points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
    if (point->observations.size() < 2 || !pose_of.contains(point->reference.keyframe)) return;
    const auto index = static_cast<std::uint32_t>(built.points.size());
    built.points.push_back(point->id);
    built.problem.points.push_back(point->position);
    for (const map::Observation& observation : point->observations) {
      const image::Keypoint& keypoint = map.keyframe(observation.keyframe).keypoints()[observation.feature];
      built.problem.observations.push_back({pose_of.at(observation.keyframe), index,
                                            Vector2d(keypoint.x_px, keypoint.y_px),
                                            map.info().orb.Scale(keypoint.octave)});
    }
  });
  return built;
}

}  // namespace

absl::Status FullAdjustmentOptions::Validate() const {
  if (first_iterations < 1 || second_iterations < 0) {
    return absl::InvalidArgumentError("full adjustment: first_iterations must be at least 1, second_iterations 0");
  }
  return absl::OkStatus();
}

absl::StatusOr<FullAdjustment> ComputeFullAdjustment(const map::Snapshot& map, ComponentId component,
                                                     const FullAdjustmentOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  const Built built = Build(map, component, options.session);
  if (built.keyframes.size() < 2 || built.points.empty()) {
    return absl::FailedPreconditionError(
        "full adjustment: the component has fewer than two keyframes that share points");
  }
  optimization::BundleAdjustmentOptions adjustment;
  adjustment.first_iterations = options.first_iterations;
  adjustment.second_iterations = options.second_iterations;
  adjustment.stop = options.stop;
  CAIRN_ASSIGN_OR_RETURN(const optimization::BundleResult result,
                         optimization::AdjustBundle(built.problem, adjustment));
  FullAdjustment full;
  full.interrupted = result.interrupted;
  if (full.interrupted) return full;
  full.observations = static_cast<int>(result.inlier.size());
  full.iterations = result.iterations;
  full.rmse = result.inlier_rmse;
  for (std::size_t i = 0; i < built.keyframes.size(); ++i) {
    full.camera_from_map[built.keyframes[i]] = result.camera_from_map[i];
  }
  std::vector<int> inliers(built.points.size(), 0);
  for (std::size_t i = 0; i < result.inlier.size(); ++i) {
    const optimization::BundleObservation& observation = built.problem.observations[i];
    inliers[observation.point] += result.inlier[i];
    if (!result.inlier[i])
      full.rejected.emplace_back(built.points[observation.point], built.keyframes[observation.pose]);
  }
  for (std::size_t i = 0; i < built.points.size(); ++i) {
    if (inliers[i] >= 2) full.positions[built.points[i]] = result.points[i];
  }
  return full;
}

AdjustmentMerge::AdjustmentMerge(FullAdjustment adjustment) : adjustment_(std::move(adjustment)) {
  order_.reserve(adjustment_.camera_from_map.size());
  for (const auto& [id, pose] : adjustment_.camera_from_map) order_.push_back(id);
  std::ranges::sort(order_);
  for (const auto& [id, position] : adjustment_.positions) {
    if (id.value() >= merged_.size()) merged_.resize(id.value() + std::size_t{1});
  }
  std::ranges::sort(adjustment_.rejected, {}, [](const auto& pair) { return std::pair(pair.second, pair.first); });
}

void AdjustmentMerge::MergeNext(map::Edit& edit, std::size_t max_points) {
  points_moved_ = 0;
  const std::size_t first = next_;
  for (; next_ < order_.size() && points_moved_ < max_points; ++next_) {
    const KeyframeId id = order_[next_];
    if (edit.base().keyframes().Contains(id)) MoveKeyframe(id, adjustment_.camera_from_map.at(id), edit);
  }
  // Behind all moves, as an observation that goes can take its point with it.
  for (std::size_t i = first; i < next_; ++i) DropRejected(order_[i], edit);
  if (next_ < order_.size()) return;
  // Those whose reference has changed from a keyframe behind to one before.
  auto& left = adjustment_.positions;
  for (auto point = left.begin(); point != left.end() && points_moved_ < max_points; point = left.erase(point)) {
    if (edit.FindPoint(point->first) == nullptr) continue;
    edit.SetPosition(point->first, point->second);
    ++points_moved_;
  }
}

// With the descendants that were not adjusted, down to the next that were.
void AdjustmentMerge::MoveKeyframe(KeyframeId id, const SE3& camera_from_map, map::Edit& edit) {
  std::vector<std::pair<KeyframeId, SE3>> moving = {{id, camera_from_map}};
  while (!moving.empty()) {
    const auto [moved, pose] = moving.back();
    moving.pop_back();
    const map::Keyframe& before = edit.base().keyframe(moved);
    for (const KeyframeId child : before.children) {
      if (adjustment_.camera_from_map.contains(child) || !followed_.insert(child).second) continue;
      const SE3 from_parent = edit.base().keyframe(child).camera_from_map * before.camera_from_map.Inverse();
      moving.emplace_back(child, from_parent * pose);
    }
    MovePoints(before, pose, edit);
    edit.SetPose(moved, pose);
  }
}

// Those that it is the reference of.
void AdjustmentMerge::MovePoints(const map::Keyframe& keyframe, const SE3& camera_from_map, map::Edit& edit) {
  const SE3 map_from_camera = camera_from_map.Inverse();
  for (const PointId id : keyframe.points) {
    if (!id) continue;
    const map::MapPoint& point = *edit.base().points().Find(id);
    // Its reference may have changed since, from a keyframe before.
    if (point.reference.keyframe != keyframe.id || IsMerged(id)) continue;
    if (const auto adjusted = adjustment_.positions.find(id); adjusted != adjustment_.positions.end()) {
      edit.SetPosition(id, adjusted->second);
      adjustment_.positions.erase(adjusted);
      merged_[id.value()] = true;
    } else {
      edit.SetPosition(id, map_from_camera * (keyframe.camera_from_map * point.position));
    }
    ++points_moved_;
  }
}

void AdjustmentMerge::DropRejected(KeyframeId id, map::Edit& edit) const {
  const auto before = [](const std::pair<PointId, KeyframeId>& pair, KeyframeId other) { return pair.second < other; };
  auto rejected = std::lower_bound(adjustment_.rejected.begin(), adjustment_.rejected.end(), id, before);
  for (; rejected != adjustment_.rejected.end() && rejected->second == id; ++rejected) {
    if (edit.FindPoint(rejected->first) != nullptr && edit.FindKeyframe(id) != nullptr) {
      edit.RemoveObservation(rejected->first, id);
    }
  }
}

void MergeFullAdjustment(FullAdjustment adjustment, map::Edit& edit) {
  AdjustmentMerge merge(std::move(adjustment));
  while (!merge.done()) merge.MergeNext(edit, std::numeric_limits<std::size_t>::max());
}

}  // namespace cairn::mapping
