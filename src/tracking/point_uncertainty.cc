#include "tracking/point_uncertainty.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace cairn::tracking {
namespace {

// Of a keypoint, in pixels of its level: corners are refined to about that (image/orb_detection.h).
constexpr double kKeypointSigma = 0.5;

}  // namespace

double ProjectedSigma(const map::Snapshot& map, const map::MapPoint& point, const Vector3d& centre, double focal_px,
                      double max_px) {
  Matrix3d information = Matrix3d::Zero();
  for (const map::Observation& observation : point.observations) {
    const map::Keyframe* keyframe = map.keyframes().Find(observation.keyframe);
    if (keyframe == nullptr) continue;
    const Vector3d ray = (keyframe->camera_from_map * point.position).normalized();
    const Vector3d in_map = keyframe->camera_from_map.rotation().conjugate() * ray;
    information += Matrix3d::Identity() - in_map * in_map.transpose();
  }
  const Vector3d to_point = point.position - centre;
  const double distance = to_point.norm();
  if (!(distance > 0.0) || !(point.pixel_size > 0.0f)) return 0.0;
  // Along the rays nothing but parallax tells where the point is; without any it may be anywhere.
  information.diagonal().array() += 1e-6;
  const double sigma = kKeypointSigma * point.pixel_size;
  const Matrix3d covariance = information.inverse() * (sigma * sigma);
  const Vector3d ray = to_point / distance;
  const double across = covariance.trace() - ray.dot(covariance * ray);
  return std::min(max_px, focal_px / distance * std::sqrt(std::max(0.0, across) / 2.0));
}

}  // namespace cairn::tracking
