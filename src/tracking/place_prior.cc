#include "tracking/place_prior.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/median.h"

namespace cairn::tracking {
namespace {

// Two cameras that see the same points look at most so far apart, ...
constexpr double kMaxViewAngleRad = std::numbers::pi / 2.0;
// ... and are from each other at most so many times as far as the points are.
constexpr double kMaxViewDistance = 2.0;
constexpr std::size_t kSampledPoints = 24;  // of a keyframe, for how far it sees

double MedianDepth(const map::Snapshot& map, const map::Keyframe& keyframe) {
  std::vector<double> depths;
  for (const PointId id : keyframe.points) {
    if (!id) continue;
    if (const map::MapPoint* point = map.points().Find(id)) {
      depths.push_back((keyframe.camera_from_map * point->position).z());
    }
    if (depths.size() == kSampledPoints) break;
  }
  return depths.empty() ? 0.0 : Median(std::move(depths));
}

bool Allows(const PlacePrior& prior, const map::Snapshot& map, const map::Keyframe& keyframe) {
  const Vector3d axis = prior.map_from_camera.rotation() * Vector3d::UnitZ();
  const Vector3d keyframe_axis = keyframe.camera_from_map.rotation().conjugate() * Vector3d::UnitZ();
  const double angle_rad = std::acos(std::clamp(axis.dot(keyframe_axis), -1.0, 1.0));
  if (angle_rad > kMaxViewAngleRad + kMaxPriorSigmas * prior.rotation_sigma_rad) return false;
  const double distance =
      (prior.map_from_camera.translation() - keyframe.CenterInMap()).norm() - kMaxPriorSigmas * prior.translation_sigma;
  return distance <= 0.0 || distance <= kMaxViewDistance * MedianDepth(map, keyframe);
}

}  // namespace

absl::Status PlacePrior::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("prior: ", what)); };
  if (!component) return bad("names no component of the map");
  if (!map_from_camera.translation().allFinite() || !map_from_camera.rotation().coeffs().allFinite()) {
    return bad("the pose is not finite");
  }
  if (!(translation_sigma > 0.0 && rotation_sigma_rad > 0.0)) return bad("the standard deviations must be positive");
  return absl::OkStatus();
}

double PlacePrior::SigmasFrom(const SE3& other_map_from_camera) const {
  const double distance = (other_map_from_camera.translation() - map_from_camera.translation()).norm();
  const double angle_rad = AngleRad(map_from_camera.rotation().conjugate() * other_map_from_camera.rotation());
  return std::max(distance / translation_sigma, angle_rad / rotation_sigma_rad);
}

bool SearchArea::MayShareView(const map::Snapshot& map, const map::Keyframe& keyframe) const {
  if (!Contains(keyframe.component)) return false;
  return priors.empty() || std::ranges::any_of(priors, [&](const PlacePrior& prior) {
           return prior.component == keyframe.component && Allows(prior, map, keyframe);
         });
}

double SearchArea::SigmasFrom(ComponentId component, const SE3& map_from_camera) const {
  if (priors.empty()) return 0.0;
  double least = std::numeric_limits<double>::infinity();
  for (const PlacePrior& prior : priors) {
    if (prior.component == component) least = std::min(least, prior.SigmasFrom(map_from_camera));
  }
  return least;
}

}  // namespace cairn::tracking
