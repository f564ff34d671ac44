#include "mapping/trajectory_quality.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <unordered_map>

#include "absl/strings/str_format.h"
#include "base/median.h"
#include "mapping/adjustment_problem.h"
#include "mapping/local_adjustment.h"
#include "optimization/pose_covariance.h"
#include "optimization/reprojection.h"
#include "tracking/map_error.h"

namespace cairn::mapping {
namespace {

struct Sums {
  double chi2 = 0.0;
  std::vector<double> depths;
};

std::vector<Sums> SumsOf(const optimization::BundleProblem& problem) {
  std::vector<Sums> sums(problem.poses.size());
  for (const optimization::BundleObservation& o : problem.observations) {
    const optimization::BundlePose& pose = problem.poses[o.pose];
    const Vector3d point_c = pose.camera_from_map * problem.points[o.point];
    if (!optimization::InFront(point_c)) continue;
    sums[o.pose].chi2 +=
        optimization::ReprojectionResidual(problem.cameras[pose.camera], point_c, o.pixel).squaredNorm() /
        (o.sigma_px * o.sigma_px);
    sums[o.pose].depths.push_back(point_c.z());
  }
  return sums;
}

// Of the keyframes that the session has in one component: what noise and model let expect of each.
void SigmasInMap(const map::Edit& edit, const std::vector<KeyframeId>& own, const TrajectoryQualityOptions& options,
                 std::unordered_map<KeyframeId, KeyframeSigma>* sigmas) {
  LocalAdjustmentOptions all;
  all.max_fixed_keyframes = 0;
  AdjustmentProblem built = BuildAdjustmentProblem(edit, own, all);
  if (built.only_anchor) built.problem.poses[*built.only_anchor].fixed = false;
  const std::vector<std::uint8_t> used(built.problem.observations.size(), 1);
  const auto noise = optimization::UncertaintyOfPoses(built.problem, used, options.max_keyframes);
  const std::vector<Sums> sums = SumsOf(built.problem);
  const tracking::MapErrorOptions law = {options.depth_share, options.rotation_rad};
  for (std::size_t i = 0; i < own.size(); ++i) {
    const auto count = static_cast<double>(sums[i].depths.size());
    if (count == 0) continue;
    const tracking::MapError model = tracking::MapErrorOf(
        {static_cast<int>(count), std::sqrt(0.5 * sums[i].chi2 / count), Median(sums[i].depths)}, law);
    KeyframeSigma& sigma = (*sigmas)[built.keyframes[i]];
    sigma = {model.translation, model.rotation_rad};
    if (!noise.ok()) continue;
    sigma.position = std::hypot(sigma.position, options.noise_factor * noise->poses[i].position);
    sigma.rotation_rad = std::hypot(sigma.rotation_rad, options.noise_factor * noise->poses[i].rotation_rad);
  }
}

// Points seen at least three times and on both sides of the moment after each of `own`, which are in temporal order;
// nothing where others' keyframes hold the map together.
std::vector<int> Carrying(const map::Snapshot& map, const std::vector<KeyframeId>& own) {
  std::unordered_map<KeyframeId, std::size_t> index_of;
  for (std::size_t i = 0; i < own.size(); ++i) index_of[own[i]] = i;
  std::vector<int> change(own.size() + 1, 0);
  for (const KeyframeId id : own) {
    for (const PointId point : map.keyframe(id).points) {
      if (!point) continue;
      std::size_t first = own.size(), last = 0, seen = 0;
      for (const map::Observation& observation : map.point(point).observations) {
        const auto index = index_of.find(observation.keyframe);
        if (index == index_of.end()) return {};
        first = std::min(first, index->second);
        last = std::max(last, index->second);
        ++seen;
      }
      if (seen < 3 || first != index_of.at(id)) continue;
      ++change[first];
      --change[last];
    }
  }
  std::vector<int> carrying;
  int points = 0;
  for (std::size_t i = 0; i + 1 < own.size(); ++i) carrying.push_back(points += change[i]);
  return carrying;
}

double SpreadOf(std::span<const TrajectoryKeyframe> keyframes) {
  Vector3d mean = Vector3d::Zero();
  double count = 0.0, sum = 0.0;
  for (const TrajectoryKeyframe& keyframe : keyframes) {
    if (!keyframe.located) continue;
    mean += keyframe.map_from_camera.translation();
    ++count;
  }
  if (count == 0.0) return 0.0;
  mean /= count;
  for (const TrajectoryKeyframe& keyframe : keyframes) {
    if (keyframe.located) sum += (keyframe.map_from_camera.translation() - mean).squaredNorm();
  }
  return std::sqrt(sum / count);
}

// Keyframes that are not in the map err like the nearest that is.
void FillBetween(std::span<const TrajectoryKeyframe> keyframes, std::vector<KeyframeSigma>* sigmas) {
  const auto known = [&](std::size_t i) { return (*sigmas)[i].position > 0.0; };
  std::optional<std::size_t> before;
  for (std::size_t i = 0; i < sigmas->size(); ++i) {
    if (known(i)) {
      before = i;
      continue;
    }
    std::size_t after = i + 1;
    while (after < sigmas->size() && !known(after)) ++after;
    const bool has_after = after < sigmas->size() && keyframes[after].segment == keyframes[i].segment;
    const bool has_before = before && keyframes[*before].segment == keyframes[i].segment;
    if (has_before && (!has_after || i - *before <= after - i)) {
      (*sigmas)[i] = (*sigmas)[*before];
    } else if (has_after) {
      (*sigmas)[i] = (*sigmas)[after];
    }
    if (known(i)) before = i;
  }
}

// How far apart the two trajectories are in each stretch, per axis.
void AddDisagreement(std::span<const TrajectoryKeyframe> refined, std::span<const TrajectoryKeyframe> reported,
                     std::span<const Stretch> direct, std::vector<KeyframeSigma>* sigmas) {
  for (const Stretch& stretch : direct) {
    double position = 0.0, rotation = 0.0;
    for (std::size_t i = stretch.begin; i < stretch.end; ++i) {
      const SE3 step = refined[i].map_from_camera.Inverse() * reported[i].map_from_camera;
      const auto count = static_cast<double>(3 * (stretch.end - stretch.begin));
      position += step.translation().squaredNorm() / count;
      rotation += std::pow(AngleRad(step.rotation()), 2) / count;
    }
    for (std::size_t i = stretch.begin; i < stretch.end; ++i) {
      KeyframeSigma& sigma = (*sigmas)[i];
      sigma = {std::hypot(sigma.position, std::sqrt(position)), std::hypot(sigma.rotation_rad, std::sqrt(rotation))};
    }
  }
}

}  // namespace

TrajectoryQuality AssessTrajectory(const std::shared_ptr<const map::Snapshot>& map,
                                   std::span<const TrajectoryKeyframe> refined,
                                   std::span<const TrajectoryKeyframe> reported, std::span<const Stretch> direct,
                                   const TrajectoryQualityOptions& options) {
  TrajectoryQuality quality;
  std::map<ComponentId, std::vector<KeyframeId>> own_of;
  for (const TrajectoryKeyframe& keyframe : refined) {
    if (keyframe.keyframe) own_of[map->keyframe(keyframe.keyframe).component].push_back(keyframe.keyframe);
  }
  std::unordered_map<KeyframeId, KeyframeSigma> sigmas;
  const map::Edit edit(map);
  quality.weakest_points = -1;
  for (const auto& [component, own] : own_of) {
    SigmasInMap(edit, own, options, &sigmas);
    const std::vector<int> carrying = Carrying(*map, own);
    for (std::size_t i = 0; i < carrying.size(); ++i) {
      if (quality.weakest_points >= 0 && carrying[i] >= quality.weakest_points) continue;
      quality.weakest_points = carrying[i];
      quality.weakest_ns = map->keyframe(own[i]).time_ns;
    }
  }
  for (const TrajectoryKeyframe& keyframe : refined) {
    const auto known = sigmas.find(keyframe.keyframe);
    quality.keyframes.push_back(keyframe.keyframe && known != sigmas.end() ? known->second : KeyframeSigma());
  }
  FillBetween(refined, &quality.keyframes);
  AddDisagreement(refined, reported, direct, &quality.keyframes);

  quality.spread = SpreadOf(reported);
  quality.quality = 1.0;
  double weak = 0.0;
  if (quality.weakest_points >= 0) {
    const double points = std::max(1, quality.weakest_points), enough = options.carrying_points;
    quality.quality = points / (points + enough);
    weak = std::max(0.0, enough / points - 1.0) * options.spread_share * quality.spread / std::sqrt(3.0);
  }
  double sum = 0.0, known = 0.0;
  for (KeyframeSigma& sigma : quality.keyframes) {
    if (!(sigma.position > 0.0)) continue;
    sigma.position = std::hypot(sigma.position, weak);
    sum += sigma.position * sigma.position;
    ++known;
  }
  if (known > 0.0) quality.position_sigma = std::sqrt(sum / known);
  const double share = quality.spread > 0.0 ? std::sqrt(3.0) * quality.position_sigma / quality.spread : 0.0;
  const double share_in_limits = share / options.spread_share;
  quality.quality = std::min(quality.quality, 1.0 / (1.0 + share_in_limits * share_in_limits));
  if (quality.quality >= kQualityLimit) return quality;
  quality.warning =
      weak > 0.0 ? absl::StrFormat(
                       "around %.1f s only %d points carry the scale on: what is before and after may differ in it",
                       ToSeconds(quality.weakest_ns - refined.front().time_ns), quality.weakest_points)
                 : absl::StrFormat("positions are uncertain by %.0f %% of the trajectory's spread", 100.0 * share);
  return quality;
}

}  // namespace cairn::mapping
