#include "inspect/measures.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "absl/strings/str_cat.h"

namespace cairn::inspect {
namespace {

constexpr double kDegreesPerRadian = 180.0 / std::numbers::pi;
constexpr std::size_t kComparedRays = 32;

double AngleDeg(const Vector3d& a, const Vector3d& b) {
  return std::atan2(a.cross(b).norm(), a.dot(b)) * kDegreesPerRadian;
}

}  // namespace

std::optional<MeasuredObservation> Measure(const map::Snapshot& map, const map::Keyframe& keyframe,
                                           std::uint32_t feature) {
  const PointId id = keyframe.points[feature];
  if (!id) return std::nullopt;
  const Vector3d point_c = keyframe.camera_from_map * map.point(id).position;
  if (!(point_c.z() > 0.0)) return std::nullopt;
  const image::Keypoint keypoint = keyframe.features.Get()->features.keypoints[feature];
  MeasuredObservation measured;
  measured.feature = feature;
  measured.point = id;
  measured.error_px = Vector2d(keypoint.x_px, keypoint.y_px) - map.pinhole(keyframe.camera).Project(point_c);
  measured.depth = point_c.z();
  measured.octave = keypoint.octave;
  return measured;
}

std::vector<MeasuredObservation> Measure(const map::Snapshot& map, const map::Keyframe& keyframe) {
  std::vector<MeasuredObservation> all;
  for (std::uint32_t i = 0; i < keyframe.points.size(); ++i) {
    if (const auto measured = Measure(map, keyframe, i)) all.push_back(*measured);
  }
  return all;
}

std::optional<double> ErrorRmsPx(const std::vector<MeasuredObservation>& observations) {
  if (observations.empty()) return std::nullopt;
  double sum = 0.0;
  for (const MeasuredObservation& observation : observations) sum += observation.error_px.squaredNorm();
  return std::sqrt(sum / static_cast<double>(observations.size()));
}

std::optional<double> ErrorRmsPx(const map::Snapshot& map, const map::MapPoint& point) {
  std::vector<MeasuredObservation> observations;
  for (const map::Observation& observation : point.observations) {
    const auto measured = Measure(map, map.keyframe(observation.keyframe), observation.feature);
    if (measured) observations.push_back(*measured);
  }
  return ErrorRmsPx(observations);
}

double MedianDepth(const std::vector<MeasuredObservation>& observations) {
  if (observations.empty()) return 0.0;
  std::vector<double> depths;
  for (const MeasuredObservation& observation : observations) depths.push_back(observation.depth);
  const auto middle = depths.begin() + static_cast<std::ptrdiff_t>(depths.size() / 2);
  std::nth_element(depths.begin(), middle, depths.end());
  return *middle;
}

int NumPoints(const map::Keyframe& keyframe) {
  return static_cast<int>(std::ranges::count_if(keyframe.points, [](PointId id) { return id.valid(); }));
}

int NumCovisible(const map::Keyframe& keyframe) {
  return static_cast<int>(std::ranges::count_if(keyframe.covisible, [](const map::CovisibilityEdge& edge) {
    return edge.shared_points >= map::kMinCovisiblePoints;
  }));
}

double ParallaxDeg(const map::Snapshot& map, const map::MapPoint& point) {
  std::vector<Vector3d> rays;
  const std::size_t count = std::min(kComparedRays, point.observations.size());
  for (std::size_t i = 0; i < count; ++i) {
    const map::Observation& observation =
        point.observations[i * (point.observations.size() - 1) / std::max<std::size_t>(1, count - 1)];
    rays.push_back(point.position - map.keyframe(observation.keyframe).CenterInMap());
  }
  double largest = 0.0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) largest = std::max(largest, AngleDeg(rays[i], rays[j]));
  }
  return largest;
}

ComponentId ComponentOf(const map::Snapshot& map, const map::MapPoint& point) {
  return map.keyframe(point.reference.keyframe).component;
}

Vector3d Placed(const map::Snapshot& map, ComponentId component, const Vector3d& position) {
  const auto& world_from_map = map.WorldFrom(component);
  return world_from_map ? *world_from_map * position : position;
}

SE3 PlacedPose(const map::Snapshot& map, const map::Keyframe& keyframe) {
  const SE3 map_from_camera = keyframe.camera_from_map.Inverse();
  const auto& world_from_map = map.WorldFrom(keyframe.component);
  return world_from_map ? world_from_map->TransformPose(map_from_camera) : map_from_camera;
}

double PlacedScale(const map::Snapshot& map, ComponentId component) {
  const auto& world_from_map = map.WorldFrom(component);
  return world_from_map ? world_from_map->scale() : 1.0;
}

double AxisAngleDeg(const SE3& a_from_map, const SE3& b_from_map) {
  return AngleDeg(a_from_map.RotationMatrix().row(2).transpose(), b_from_map.RotationMatrix().row(2).transpose());
}

std::vector<ComponentId> TogetherInOneFrame(const map::Snapshot& map) {
  std::vector<ComponentId> together;
  ComponentId largest;
  for (const ComponentId id : map.LiveComponents()) {
    if (map.WorldFrom(id)) together.push_back(id);
    if (!largest || map.NumKeyframes(id) > map.NumKeyframes(largest)) largest = id;
  }
  if (together.empty() && largest) together.push_back(largest);
  return together;
}

std::string LeftOut::Text() const {
  if (components == 0) return "";
  return absl::StrCat("without ", keyframes, " keyframes of ", components,
                      components == 1 ? " component in another frame" : " components in other frames");
}

LeftOut LeftOutBesides(const map::Snapshot& map, const std::vector<ComponentId>& told) {
  LeftOut left_out;
  for (const ComponentId id : map.LiveComponents()) {
    if (std::ranges::find(told, id) != told.end() || map.NumKeyframes(id) == 0) continue;
    ++left_out.components;
    left_out.keyframes += static_cast<std::int64_t>(map.NumKeyframes(id));
  }
  return left_out;
}

absl::Status StatusOfRead(const map::Snapshot& map) {
  return map.feature_cache() == nullptr ? absl::OkStatus() : map.feature_cache()->status();
}

}  // namespace cairn::inspect
