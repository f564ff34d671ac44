#include "mapping/full_adjustment.h"

#include <algorithm>
#include <functional>

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

void MergeFullAdjustment(const FullAdjustment& adjustment, map::Edit& edit) {
  const map::Snapshot& base = edit.base();
  // New poses of all keyframes: adjusted, or where the parent's movement takes them; parents first.
  std::unordered_map<KeyframeId, SE3> moved;
  const std::function<const SE3*(KeyframeId)> resolve = [&](KeyframeId id) -> const SE3* {
    if (const auto known = moved.find(id); known != moved.end()) return &known->second;
    const map::Keyframe& keyframe = base.keyframe(id);
    if (const auto adjusted = adjustment.camera_from_map.find(id); adjusted != adjustment.camera_from_map.end()) {
      return &moved.emplace(id, adjusted->second).first->second;
    }
    if (!keyframe.parent) return nullptr;
    const SE3* parent = resolve(keyframe.parent);
    if (parent == nullptr) return nullptr;
    const SE3 from_parent = keyframe.camera_from_map * base.keyframe(keyframe.parent).camera_from_map.Inverse();
    return &moved.emplace(id, from_parent * *parent).first->second;
  };
  base.keyframes().ForEach([&](const std::shared_ptr<const map::Keyframe>& keyframe) {
    if (const SE3* pose = resolve(keyframe->id)) edit.SetPose(keyframe->id, *pose);
  });
  base.points().ForEach([&](const std::shared_ptr<const map::MapPoint>& point) {
    if (const auto adjusted = adjustment.positions.find(point->id); adjusted != adjustment.positions.end()) {
      edit.SetPosition(point->id, adjusted->second);
      return;
    }
    const auto reference = moved.find(point->reference.keyframe);
    if (reference == moved.end()) return;
    const Vector3d in_camera = base.keyframe(reference->first).camera_from_map * point->position;
    edit.SetPosition(point->id, reference->second.Inverse() * in_camera);
  });
  for (const auto& [point, keyframe] : adjustment.rejected) {
    if (edit.FindPoint(point) != nullptr && edit.FindKeyframe(keyframe) != nullptr) {
      edit.RemoveObservation(point, keyframe);
    }
  }
}

}  // namespace cairn::mapping
