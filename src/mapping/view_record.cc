#include "mapping/view_record.h"

#include <algorithm>

#include "optimization/pose_refinement.h"

namespace cairn::mapping {

ViewRecord MakeViewRecord(std::span<const image::Keypoint> keypoints, std::span<const PointId> points,
                          const image::OrbParameters& orb) {
  ViewRecord view;
  for (std::size_t i = 0; i < std::min(keypoints.size(), points.size()); ++i) {
    if (!points[i]) continue;
    view.sights.push_back(
        {points[i], keypoints[i].x_px, keypoints[i].y_px, static_cast<float>(orb.Scale(keypoints[i].octave))});
  }
  return view;
}

std::optional<SE3> RefineView(const map::Snapshot& map, const Pinhole& pinhole, const ViewRecord& view,
                              const SE3& guess, int min_inliers) {
  std::vector<optimization::PoseObservation> observations;
  for (const ViewRecord::Sight& sight : view.sights) {
    const map::MapPoint* point = map.points().Find(sight.point);
    if (point != nullptr) observations.push_back({point->position, Vector2d(sight.x_px, sight.y_px), sight.sigma_px});
  }
  if (static_cast<int>(observations.size()) < min_inliers) return std::nullopt;
  const auto refined = optimization::RefinePose(pinhole, guess, observations);
  if (!refined.ok() || refined->num_inliers < min_inliers) return std::nullopt;
  return refined->camera_from_map;
}

}  // namespace cairn::mapping
