#include "mapping/adjustment_problem.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "base/dense_ids.h"

namespace cairn::mapping {
namespace {

std::vector<PointId> SharedPointsOf(const map::Edit& edit, std::span<const KeyframeId> keyframes) {
  std::vector<PointId> points;
  for (const KeyframeId id : keyframes) {
    for (const PointId point : edit.keyframe(id).points) {
      // A single ray adds nothing.
      if (point && edit.point(point).observations.size() >= 2) points.push_back(point);
    }
  }
  SortUnique(&points);
  return points;
}

// The keyframes that are not free but see the points, most points first.
std::vector<KeyframeId> Observers(const map::Edit& edit, std::span<const PointId> points,
                                  std::span<const KeyframeId> free, int max_count) {
  std::vector<int> count(edit.next_keyframe().value(), 0);
  for (const PointId point : points) {
    for (const map::Observation& observation : edit.point(point).observations) ++count[observation.keyframe.value()];
  }
  for (const KeyframeId id : free) count[id.value()] = 0;
  std::vector<std::pair<int, KeyframeId>> order;
  for (std::uint32_t id = 0; id < count.size(); ++id) {
    if (count[id] > 0) order.emplace_back(-count[id], KeyframeId(id));
  }
  std::sort(order.begin(), order.end());
  if (max_count > 0 && static_cast<int>(order.size()) > max_count) order.resize(static_cast<std::size_t>(max_count));
  std::vector<KeyframeId> observers;
  for (const auto& [seen, id] : order) observers.push_back(id);
  return observers;
}

}  // namespace

AdjustmentProblem BuildAdjustmentProblem(const map::Edit& edit, std::span<const KeyframeId> free,
                                         const LocalAdjustmentOptions& options) {
  AdjustmentProblem built;
  built.points = SharedPointsOf(edit, free);
  const std::vector<KeyframeId> fixed = Observers(edit, built.points, free, options.max_fixed_keyframes);
  built.keyframes.assign(free.begin(), free.end());
  built.keyframes.insert(built.keyframes.end(), fixed.begin(), fixed.end());
  const bool floats = fixed.empty() && options.priors.empty();
  const KeyframeId anchor = floats ? *std::min_element(free.begin(), free.end()) : KeyframeId();

  if (floats) {
    const auto at = std::find(built.keyframes.begin(), built.keyframes.end(), anchor);
    built.only_anchor = static_cast<std::uint32_t>(at - built.keyframes.begin());
  }

  std::unordered_map<CameraId, std::uint32_t> camera_of;
  constexpr auto kNone = static_cast<std::uint32_t>(-1);
  std::vector<std::uint32_t> pose_of(edit.next_keyframe().value(), kNone);
  std::vector<const image::Keypoint*> keypoints;
  for (std::uint32_t i = 0; i < built.keyframes.size(); ++i) {
    const map::Keyframe& keyframe = edit.keyframe(built.keyframes[i]);
    const auto [camera, added] =
        camera_of.try_emplace(keyframe.camera, static_cast<std::uint32_t>(built.problem.cameras.size()));
    if (added) {
      built.problem.cameras.push_back(edit.pinhole(keyframe.camera));
      built.cameras.push_back(keyframe.camera);
    }
    pose_of[keyframe.id.value()] = i;
    keypoints.push_back(keyframe.keypoints().data());
    built.problem.poses.push_back(
        {keyframe.camera_from_map, camera->second, i >= free.size() || keyframe.id == anchor || options.hold_poses});
  }
  for (const KeyframePrior& prior : options.priors) {
    const std::uint32_t pose = pose_of[prior.keyframe.value()];
    if (pose == kNone || pose >= free.size()) continue;
    built.problem.priors.push_back({pose, prior.camera_from_map, prior.position_sigma, prior.rotation_sigma_rad});
  }
  for (const KeyframeRotation& rotation : options.rotations) {
    const std::uint32_t a = pose_of[rotation.a.value()], b = pose_of[rotation.b.value()];
    if (a == kNone || b == kNone) continue;
    built.problem.rotations.push_back({a, b, rotation.b_from_a, static_cast<double>(rotation.steps)});
  }
  std::vector<double> sigma;
  for (int octave = 0; octave < edit.info().orb.num_levels; ++octave) sigma.push_back(edit.info().orb.Scale(octave));
  for (std::uint32_t p = 0; p < built.points.size(); ++p) {
    const map::MapPoint& point = edit.point(built.points[p]);
    built.problem.points.push_back(point.position);
    for (const map::Observation& observation : point.observations) {
      const std::uint32_t pose = pose_of[observation.keyframe.value()];
      if (pose == kNone) continue;
      const image::Keypoint& keypoint = keypoints[pose][observation.feature];
      built.problem.observations.push_back({pose, p, Vector2d(keypoint.x_px, keypoint.y_px), sigma[keypoint.octave]});
    }
  }
  return built;
}

void KeepScale(const AdjustmentProblem& built, std::vector<SE3>* camera_from_map, std::vector<Vector3d>* points) {
  if (!built.only_anchor) return;
  const Vector3d origin = built.problem.poses[*built.only_anchor].camera_from_map.Inverse().translation();
  std::vector<double> ratios;
  for (std::size_t i = 0; i < points->size(); ++i) {
    const double ratio = (built.problem.points[i] - origin).norm() / ((*points)[i] - origin).norm();
    if (ratio > 0.0 && std::isfinite(ratio)) ratios.push_back(ratio);
  }
  if (ratios.empty()) return;
  const auto middle = ratios.begin() + static_cast<std::ptrdiff_t>(ratios.size() / 2);
  std::nth_element(ratios.begin(), middle, ratios.end());
  for (SE3& pose : *camera_from_map) {
    const Vector3d centre = origin + *middle * (pose.Inverse().translation() - origin);
    pose = SE3(pose.rotation(), -(pose.rotation() * centre));
  }
  for (Vector3d& point : *points) point = origin + *middle * (point - origin);
}

}  // namespace cairn::mapping
