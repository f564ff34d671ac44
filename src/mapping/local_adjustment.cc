#include "mapping/local_adjustment.h"

#include <algorithm>
#include <cmath>

#include "mapping/adjustment_problem.h"
#include "mapping/held.h"

namespace cairn::mapping {
namespace {

// What moves by less is left as it is: it would have to be stored anew for nothing.
constexpr double kMinMoveRad = 2e-5;  // seen from a camera: a hundredth of a pixel at a usual focal length

bool Moves(const SE3& from, const SE3& to, double depth) {
  const SE3 step = to * from.Inverse();
  return AngleRad(step.rotation()) > kMinMoveRad || step.translation().norm() > kMinMoveRad * depth;
}

// Poses and points of the result, where they differ.
void Store(const AdjustmentProblem& built, const optimization::BundleResult& result, map::Edit& edit) {
  std::vector<int> inliers(built.points.size(), 0);
  std::vector<double> depth(built.points.size(), 0.0);          // in the nearest camera
  std::vector<double> pose_depth(built.keyframes.size(), 0.0);  // of the nearest point
  for (std::size_t i = 0; i < result.inlier.size(); ++i) {
    if (!result.inlier[i]) continue;
    const optimization::BundleObservation& o = built.problem.observations[i];
    const double z = (result.camera_from_map[o.pose] * result.points[o.point]).z();
    ++inliers[o.point];
    depth[o.point] = depth[o.point] > 0.0 ? std::min(depth[o.point], z) : z;
    pose_depth[o.pose] = pose_depth[o.pose] > 0.0 ? std::min(pose_depth[o.pose], z) : z;
  }
  for (std::size_t i = 0; i < built.keyframes.size(); ++i) {
    const optimization::BundlePose& before = built.problem.poses[i];
    if (before.fixed || !Moves(before.camera_from_map, result.camera_from_map[i], pose_depth[i])) continue;
    edit.SetPose(built.keyframes[i], result.camera_from_map[i]);
  }
  for (std::size_t p = 0; p < built.points.size(); ++p) {
    if (inliers[p] < 2 || (result.points[p] - built.problem.points[p]).norm() < kMinMoveRad * depth[p]) continue;
    edit.SetPosition(built.points[p], result.points[p]);
  }
}

}  // namespace

std::vector<KeyframeId> KeyframesToAdjust(const map::Edit& edit, KeyframeId keyframe, int max_count,
                                          SessionId session) {
  std::vector<KeyframeId> free = {keyframe};
  for (const map::CovisibilityEdge& edge : edit.keyframe(keyframe).covisible) {
    if (static_cast<int>(free.size()) >= max_count || edge.shared_points < map::kMinCovisiblePoints) break;
    if (!IsHeld(edit, edit.keyframe(edge.keyframe), session)) free.push_back(edge.keyframe);
  }
  std::sort(free.begin(), free.end());
  return free;
}

absl::StatusOr<LocalAdjustmentReport> AdjustKeyframes(map::Edit& edit, std::span<const KeyframeId> free,
                                                      const LocalAdjustmentOptions& options) {
  LocalAdjustmentReport report;
  if (free.empty()) return report;
  const AdjustmentProblem built = BuildAdjustmentProblem(edit, free, options);
  report.keyframes = static_cast<int>(free.size());
  report.fixed_keyframes = static_cast<int>(built.keyframes.size() - free.size());
  report.points = static_cast<int>(built.points.size());
  report.observations = static_cast<int>(built.problem.observations.size());
  if (built.points.empty() || built.keyframes.size() < 2) return report;

  optimization::BundleAdjustmentOptions adjustment;
  adjustment.first_iterations = options.first_iterations;
  adjustment.second_iterations = options.second_iterations;
  adjustment.noise_iterations = options.noise_iterations;
  adjustment.function_tolerance = options.function_tolerance;
  CAIRN_ASSIGN_OR_RETURN(optimization::BundleResult result, optimization::AdjustBundle(built.problem, adjustment));
  KeepScale(built, &result.camera_from_map, &result.points);
  report.adjusted = true;
  report.iterations = result.iterations;
  report.rmse = result.inlier_rmse;
  report.noise_px = result.noise_px;
  report.rotation_noise_rad = result.rotation_noise_rad;
  Store(built, result, edit);
  for (std::size_t i = 0; i < result.inlier.size(); ++i) {
    if (result.inlier[i]) continue;
    const optimization::BundleObservation& observation = built.problem.observations[i];
    const PointId point = built.points[observation.point];
    if (edit.FindPoint(point) == nullptr) continue;  // gone with an earlier observation
    edit.RemoveObservation(point, built.keyframes[observation.pose]);
    ++report.rejected_observations;
  }
  return report;
}

}  // namespace cairn::mapping
