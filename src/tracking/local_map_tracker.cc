#include "tracking/local_map_tracker.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "base/median.h"
#include "optimization/pose_refinement.h"
#include "tracking/graph_distance.h"
#include "tracking/local_map.h"
#include "tracking/point_uncertainty.h"

namespace cairn::tracking {
namespace {

constexpr std::size_t kMaxNearby = 20;

// What the first round needs of the points seen before, to be enough by itself: so many of them, and this share of them
// found again.
constexpr std::size_t kEnoughSeen = 100;
constexpr double kEnoughFound = 0.5;

constexpr double kMaxProjectedSigmaPx = 50.0;

using PointList = std::span<const map::MapPoint* const>;

PointList LocalPoints(const map::Snapshot& map, std::span<const PointId> seen, KeyframeId anchor,
                      std::span<const KeyframeId> nearby, const LocalMapTrackerOptions& options,
                      LocalPointCache* cache) {
  LocalMapOptions local_options;
  local_options.max_keyframes = options.max_keyframes;
  std::vector<KeyframeId> keyframes;
  std::unordered_set<KeyframeId> known;
  const auto add = [&](KeyframeId id) {
    if (id && map.keyframes().Contains(id) && known.insert(id).second) keyframes.push_back(id);
  };
  add(anchor);
  for (const KeyframeId id : nearby) add(id);
  if (seen.empty()) {
    keyframes = LocalKeyframesAround(map, keyframes, local_options);
  } else {
    for (const KeyframeId id : LocalKeyframesOfPoints(map, seen, local_options)) add(id);
  }
  return cache->PointsOf(map, keyframes);
}

struct Round {
  bool ok = false;
  SE3 camera_from_map;
  Matrix6d covariance = Matrix6d::Zero();
  double residual_rms = 0.0;
  std::vector<PointMatch> inliers;
  std::vector<std::uint32_t> visible;
  int matches = 0;
};

Round MatchAndRefine(const map::Snapshot& map, const FeatureView& view, const SE3& seed, PointList points,
                     const ProjectionOptions& projection, const optimization::PoseRefinementOptions& refinement,
                     bool weigh_points) {
  const image::OrbParameters& orb = map.info().orb;
  const Vector3d centre = seed.Inverse().translation();
  Round round;
  ProjectionMatches matched = MatchByProjection(view, seed, points, orb, projection);
  round.matches = static_cast<int>(matched.matches.size());
  round.visible = std::move(matched.visible);
  std::vector<optimization::PoseObservation> observations;
  observations.reserve(matched.matches.size());
  for (const PointMatch& match : matched.matches) {
    const image::Keypoint& keypoint = view.features.keypoints[match.feature];
    const map::MapPoint& point = *points[match.point];
    double sigma_px = orb.Scale(keypoint.octave);
    if (weigh_points) {
      sigma_px = std::hypot(sigma_px, ProjectedSigma(map, point, centre, view.pinhole.fx_px, kMaxProjectedSigmaPx));
    }
    observations.push_back({point.position, Vector2d(keypoint.x_px, keypoint.y_px), sigma_px});
  }
  const auto refined = optimization::RefinePose(view.pinhole, seed, observations, refinement);
  if (!refined.ok()) return round;
  round.ok = true;
  round.camera_from_map = refined->camera_from_map;
  round.covariance = refined->covariance;
  round.residual_rms = std::sqrt(refined->chi2 / (2.0 * refined->num_inliers));
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (refined->inlier[i]) round.inliers.push_back(matched.matches[i]);
  }
  return round;
}

std::vector<const map::MapPoint*> Existing(const map::Snapshot& map, std::span<const PointId> ids) {
  std::vector<const map::MapPoint*> points;
  points.reserve(ids.size());
  for (const PointId id : ids) {
    if (const map::MapPoint* point = map.points().Find(id)) points.push_back(point);
  }
  return points;
}

double MedianDepth(const SE3& camera_from_map, PointList points, std::span<const PointMatch> inliers) {
  std::vector<double> depths;
  for (const auto& match : inliers) depths.push_back((camera_from_map * points[match.point]->position).z());
  return Median(std::move(depths));
}

KeyframeId MostSharing(PointList points, std::span<const PointMatch> inliers) {
  std::unordered_map<KeyframeId, int> count;
  for (const auto& match : inliers) {
    for (const map::Observation& observation : points[match.point]->observations) ++count[observation.keyframe];
  }
  KeyframeId best;
  int best_count = 0;
  for (const auto& [id, shared] : count) {
    // The newer of equal ones, whatever the order of the table.
    if (shared > best_count || (shared == best_count && id > best)) {
      best = id;
      best_count = shared;
    }
  }
  return best;
}

// Of `among`, those whose camera is within `max_distance` and looks at most `max_angle_deg` away, at most `max_count`,
// best first.
std::vector<KeyframeId> NearbyKeyframes(const map::Snapshot& map, std::span<const KeyframeId> among,
                                        const SE3& camera_from_map, double max_distance, double max_angle_deg,
                                        std::size_t max_count) {
  const double min_cosine = std::cos(max_angle_deg * std::numbers::pi / 180.0);
  const Vector3d centre = camera_from_map.Inverse().translation();
  const Vector3d axis = camera_from_map.rotation().conjugate() * Vector3d::UnitZ();
  std::vector<std::pair<double, KeyframeId>> found;
  for (const KeyframeId id : among) {
    const map::Keyframe& keyframe = map.keyframe(id);
    const double cosine = axis.dot(keyframe.camera_from_map.rotation().conjugate() * Vector3d::UnitZ());
    if (cosine < min_cosine) continue;
    const double distance = (keyframe.CenterInMap() - centre).norm();
    if (distance > max_distance) continue;
    found.emplace_back(distance / max_distance + (1.0 - cosine) / (1.0 - min_cosine), id);
  }
  std::sort(found.begin(), found.end());
  if (found.size() > max_count) found.resize(max_count);
  std::vector<KeyframeId> ids;
  for (const auto& [score, id] : found) ids.push_back(id);
  return ids;
}

}  // namespace

absl::Status LocalMapTrackerOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("local map: ", what)); };
  if (min_inliers < 10) return bad("min_inliers must be at least 10");
  if (max_keyframes < 1) return bad("max_keyframes must be at least 1");
  if (!(search_radius_px > 0.0) || !(refined_search_radius_px > 0.0)) return bad("search radii must be positive");
  if (!(neighbour_distance >= 0.0)) return bad("neighbour_distance must not be negative");
  if (!(neighbour_way >= 0.0)) return bad("neighbour_way must not be negative");
  if (!(neighbour_angle_deg > 0.0 && neighbour_angle_deg < 180.0))
    return bad("neighbour_angle_deg must be in (0, 180)");
  return absl::OkStatus();
}

TrackedView TrackLocalMap(const map::Snapshot& map, const FeatureView& view, const LocalMapStart& start,
                          const LocalMapTrackerOptions& options) {
  const PoseSeed& seed = start.seed;
  TrackedView result;
  result.camera_from_map = seed.camera_from_map;
  result.points.assign(view.features.size(), PointId());
  optimization::PoseRefinementOptions refinement;
  if (seed.translation_sigma > 0.0 && seed.rotation_sigma_rad > 0.0) {
    refinement.prior = {seed.camera_from_map, seed.translation_sigma, seed.rotation_sigma_rad};
  }
  const double reach = options.neighbour_distance * start.median_depth;
  std::vector<KeyframeId> reachable;
  for (const auto& [id, length] : KeyframesWithin(map, start.anchor, options.neighbour_way * start.median_depth)) {
    reachable.push_back(id);
  }
  LocalPointCache own;
  const auto local_points = [&](const SE3& pose, std::span<const PointId> shared) {
    result.nearby = NearbyKeyframes(map, reachable, pose, reach, options.neighbour_angle_deg, kMaxNearby);
    if (start.cache == nullptr) own = {};  // exactly the points that are asked for
    return LocalPoints(map, shared, start.anchor, result.nearby, options, start.cache != nullptr ? start.cache : &own);
  };

  ProjectionOptions projection;
  projection.radius_factor = start.radius_factor * options.search_radius_px / kObliqueRadiusPx;
  const std::vector<const map::MapPoint*> seen =
      start.seen_first ? Existing(map, start.seen) : std::vector<const map::MapPoint*>();
  PointList points = seen;
  const auto refine = [&](const SE3& from) {
    return MatchAndRefine(map, view, from, points, projection, refinement, options.weigh_points);
  };
  Round round;
  if (seen.size() >= kEnoughSeen) round = refine(seed.camera_from_map);
  if (!round.ok || static_cast<double>(round.inliers.size()) < kEnoughFound * static_cast<double>(seen.size())) {
    points = local_points(seed.camera_from_map, start.seen);
    round = refine(seed.camera_from_map);
  }
  result.matches = round.matches;
  if (!round.ok || static_cast<int>(round.inliers.size()) < options.min_inliers / 2) return result;

  std::vector<PointId> agreed;
  for (const auto& match : round.inliers) agreed.push_back(points[match.point]->id);
  projection.radius_factor = options.refined_search_radius_px / kObliqueRadiusPx;
  const SE3 first = round.camera_from_map;
  points = local_points(first, agreed);
  round = refine(first);
  result.matches = round.matches;
  result.inliers = static_cast<int>(round.inliers.size());
  if (!round.ok || result.inliers < options.min_inliers) return result;

  result.tracked = true;
  result.camera_from_map = round.camera_from_map;
  result.covariance = round.covariance;
  result.residual_rms = round.residual_rms;
  for (const auto& match : round.inliers) result.points[match.feature] = points[match.point]->id;
  for (const std::uint32_t index : round.visible) result.visible.push_back(points[index]->id);
  result.reference = MostSharing(points, round.inliers);
  result.median_depth = MedianDepth(result.camera_from_map, points, round.inliers);
  return result;
}

}  // namespace cairn::tracking
