#include "tracking/projection_matcher.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "image/hamming.h"
#include "map/viewing.h"

namespace cairn::tracking {
namespace {

constexpr double kFrontalCosine = 0.998;  // seen within 3.6 degrees of the mean direction: the patch looks the same
constexpr int kNoDistance = 257;

// The nearest feature, and the nearest other one of the same octave: features of neighbouring octaves at one place show
// the same corner and say nothing about ambiguity.
struct Best {
  std::uint32_t feature = image::kNoFeature;
  int distance = kNoDistance;
  int second_same_octave = kNoDistance;
};

// distances[i]: of nearby[i] to the nearest of the point's descriptors.
void DistancesToPoint(const FeatureView& view, const map::MapPoint& point,
                      std::span<const image::Descriptor> descriptors, std::span<const std::uint32_t> nearby,
                      std::vector<std::uint16_t>* distances) {
  if (descriptors.empty()) descriptors = {&point.descriptor, 1};
  const std::size_t count = nearby.size();
  distances->resize(2 * count);
  const auto measure = [&](const image::Descriptor& descriptor, std::uint16_t* to) {
    image::HammingDistancesAt(descriptor, view.features.descriptors.data(), nearby.data(), count, to);
  };
  measure(descriptors[0], distances->data());
  std::uint16_t* const others = distances->data() + count;
  for (const image::Descriptor& descriptor : descriptors.subspan(1)) {
    measure(descriptor, others);
    for (std::size_t i = 0; i < count; ++i) (*distances)[i] = std::min((*distances)[i], others[i]);
  }
}

Best FindBest(const FeatureView& view, std::span<const std::uint32_t> nearby, std::span<const std::uint16_t> distances,
              std::span<const std::uint8_t> taken) {
  Best best;
  int octave_of_best = -1, distance_of_other = kNoDistance, octave_of_other = -1;
  for (std::size_t i = 0; i < nearby.size(); ++i) {
    const std::uint32_t feature = nearby[i];
    if (!taken.empty() && taken[feature]) continue;
    const int distance = distances[i];
    const int octave = view.features.keypoints[feature].octave;
    if (distance < best.distance) {
      distance_of_other = best.distance;
      octave_of_other = octave_of_best;
      best.feature = feature;
      best.distance = distance;
      octave_of_best = octave;
    } else if (distance < distance_of_other) {
      distance_of_other = distance;
      octave_of_other = octave;
    }
  }
  if (octave_of_other == octave_of_best) best.second_same_octave = distance_of_other;
  return best;
}

}  // namespace

absl::Status ProjectionOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("projection: ", what)); };
  if (!(radius_factor > 0.0 && radius_factor <= 1000.0)) return bad("radius_factor must be in (0, 1000]");
  if (max_distance < 0 || max_distance > 256) return bad("max_distance must be 0 to 256 bits");
  if (!(max_ratio > 0.0 && max_ratio <= 1.0)) return bad("max_ratio must be in (0, 1]");
  if (!(max_viewing_angle_deg > 0.0 && max_viewing_angle_deg <= 180.0)) {
    return bad("max_viewing_angle_deg must be in (0, 180]");
  }
  if (!(distance_slack >= 1.0)) return bad("distance_slack must be at least 1");
  if (octave_slack < 0) return bad("octave_slack must not be negative");
  return absl::OkStatus();
}

int PredictOctave(const map::MapPoint& point, double distance, double focal_px, const image::OrbParameters& orb) {
  if (!(distance > 0.0)) return orb.num_levels - 1;
  const double octave = std::log(focal_px * point.pixel_size / distance) / std::log(orb.scale_factor);
  if (!(octave > 0.0)) return 0;
  return static_cast<int>(std::min(std::round(octave), orb.num_levels - 1.0));
}

std::optional<PointProjection> PredictPoint(const Pinhole& pinhole, const SE3& camera_from_map,
                                            const map::MapPoint& point, const image::OrbParameters& orb,
                                            const ProjectionOptions& options) {
  const Vector3d point_c = camera_from_map * point.position;
  if (!(point_c.z() > 1e-9)) return std::nullopt;
  PointProjection projection;
  projection.pixel = pinhole.Project(point_c);
  if (!pinhole.Contains(projection.pixel)) return std::nullopt;
  projection.distance = point_c.norm();
  const map::DistanceRange range = map::FindableWithin(point.pixel_size, pinhole.fx_px, orb);
  if (projection.distance < range.min / options.distance_slack ||
      projection.distance > range.max * options.distance_slack) {
    return std::nullopt;
  }
  // The viewing direction in the camera's axes; points without a mean direction are taken as seen from the front.
  const Vector3d mean_direction = point.mean_view_direction.cast<double>();
  projection.viewing_cosine = 1.0;
  if (mean_direction.squaredNorm() > 0.25) {
    projection.viewing_cosine = point_c.dot(camera_from_map.rotation() * mean_direction) / projection.distance;
    if (projection.viewing_cosine < std::cos(options.max_viewing_angle_deg * std::numbers::pi / 180.0)) {
      return std::nullopt;
    }
  }
  projection.octave = PredictOctave(point, projection.distance, pinhole.fx_px, orb);
  projection.radius_px = options.radius_factor * orb.Scale(projection.octave) *
                         (projection.viewing_cosine > kFrontalCosine ? kFrontalRadiusPx : kObliqueRadiusPx);
  return projection;
}

ProjectionMatches MatchByProjection(const FeatureView& view, const SE3& camera_from_map,
                                    std::span<const map::MapPoint* const> points, const image::OrbParameters& orb,
                                    const ProjectionOptions& options, std::span<const std::uint8_t> taken,
                                    const DescriptorLists* descriptors) {
  ProjectionMatches result;
  // Which of result.matches has a feature; matches that lose theirs are marked and swept at the end.
  std::vector<std::int32_t> owner(view.features.size(), -1);
  std::vector<std::uint32_t> nearby;
  std::vector<std::uint16_t> distances;
  for (std::uint32_t i = 0; i < points.size(); ++i) {
    if (points[i] == nullptr) continue;
    const auto projection = PredictPoint(view.pinhole, camera_from_map, *points[i], orb, options);
    if (!projection) continue;
    result.visible.push_back(i);
    view.grid.Query(projection->pixel.x(), projection->pixel.y(), projection->radius_px,
                    projection->octave - options.octave_slack, projection->octave + options.octave_slack, &nearby);
    if (nearby.empty()) continue;
    const auto list = descriptors != nullptr ? descriptors->of(i) : std::span<const image::Descriptor>();
    DistancesToPoint(view, *points[i], list, nearby, &distances);
    const Best best = FindBest(view, nearby, distances, taken);
    if (best.distance > options.max_distance) continue;
    if (options.max_ratio < 1.0 && best.second_same_octave < kNoDistance &&
        best.distance > options.max_ratio * best.second_same_octave) {
      continue;
    }
    std::int32_t& holder = owner[best.feature];
    if (holder >= 0) {
      PointMatch& other = result.matches[static_cast<std::size_t>(holder)];
      if (other.distance <= best.distance) continue;
      other.feature = image::kNoFeature;
    }
    holder = static_cast<std::int32_t>(result.matches.size());
    result.matches.push_back({i, best.feature, best.distance});
  }
  std::erase_if(result.matches, [](const PointMatch& match) { return match.feature == image::kNoFeature; });
  return result;
}

}  // namespace cairn::tracking
