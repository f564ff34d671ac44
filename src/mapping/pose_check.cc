#include "mapping/pose_check.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "image/matching.h"

namespace cairn::mapping {
namespace {

struct Rays {
  Vector3d in_a, in_b;  // of unit length, each in its camera
};

// With the first camera's centre at t, a point at distance d along the ray a is seen in the direction t + d a: between
// t (d = 0) and a (far away), in the plane of the two.
bool Fits(const Rays& rays, const SE3& b_from_a, double tolerance_rad) {
  const Vector3d a = b_from_a.rotation() * rays.in_a;
  const Vector3d& b = rays.in_b;
  const double baseline = b_from_a.translation().norm();
  const Vector3d t = baseline > 0.0 ? Vector3d(b_from_a.translation() / baseline) : a;
  const Vector3d towards_t = t - t.dot(a) * a;
  const double sine = towards_t.norm();
  if (sine < std::sin(tolerance_rad)) return std::acos(std::clamp(a.dot(b), -1.0, 1.0)) < tolerance_rad;
  const Vector3d u = towards_t / sine;
  if (std::abs(std::asin(std::clamp(b.dot(a.cross(u)), -1.0, 1.0))) > tolerance_rad) return false;
  const double angle = std::atan2(b.dot(u), b.dot(a));
  return angle > -tolerance_rad && angle < std::acos(std::clamp(t.dot(a), -1.0, 1.0)) + tolerance_rad;
}

int CountFits(const std::vector<Rays>& rays, const SE3& b_from_a, double tolerance_rad) {
  return static_cast<int>(
      std::count_if(rays.begin(), rays.end(), [&](const Rays& r) { return Fits(r, b_from_a, tolerance_rad); }));
}

struct Count {
  int fits = 0, by_accident = 0;

  // Of so many matches; those that are wrong fit as often as matches with others would.
  double Share(int matches) const {
    const double n = matches;
    return by_accident < matches ? std::max(0.0, (fits - by_accident) / (n - by_accident)) : 0.0;
  }
};

}  // namespace

PoseCheck CheckPoses(std::span<const PosedFeatures> views, std::span<const std::pair<std::size_t, std::size_t>> pairs,
                     const Pinhole& pinhole, const PoseCheckOptions& options) {
  const double tolerance_rad = options.tolerance_deg * std::numbers::pi / 180.0;
  PoseCheck check;
  Count given, inverted;
  for (const auto& [i, j] : pairs) {
    const image::Features &a = *views[i].features, &b = *views[j].features;
    const std::vector<image::FeatureMatch> matches = image::MatchBruteForce(a, b);
    if (static_cast<int>(matches.size()) < options.min_matches_per_pair) continue;
    ++check.pairs;
    check.matches += static_cast<int>(matches.size());
    std::vector<Rays> rays, others;
    for (std::size_t k = 0; k < matches.size(); ++k) {
      const auto ray = [&](const image::Keypoint& keypoint) {
        return Vector3d(pinhole.Unproject({keypoint.x_px, keypoint.y_px}).normalized());
      };
      rays.push_back({ray(a.keypoints[matches[k].a]), ray(b.keypoints[matches[k].b])});
      others.push_back({rays.back().in_a, ray(b.keypoints[matches[(k + matches.size() / 2) % matches.size()].b])});
    }
    const SE3 b_from_a = views[j].world_from_camera.Inverse() * views[i].world_from_camera;
    const SE3 if_inverted = views[j].world_from_camera * views[i].world_from_camera.Inverse();
    given.fits += CountFits(rays, b_from_a, tolerance_rad);
    given.by_accident += CountFits(others, b_from_a, tolerance_rad);
    inverted.fits += CountFits(rays, if_inverted, tolerance_rad);
    inverted.by_accident += CountFits(others, if_inverted, tolerance_rad);
  }
  check.share = given.Share(check.matches);
  check.inverted_share = inverted.Share(check.matches);
  return check;
}

}  // namespace cairn::mapping
