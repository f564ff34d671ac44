#include "mapping/direct_trajectory.h"

#include <cmath>
#include <optional>
#include <span>

#include "geometry/alignment.h"

namespace cairn::mapping {
namespace {

// Length of the axes that stand for the orientation of a camera, against the spread of the positions: they decide how a
// straight path is turned about itself, and little else.
constexpr double kAxisShare = 0.1;
constexpr std::size_t kBeside = 12;  // keyframes on each side of a stretch that tell its scale

// Root mean square distance from the mean.
double Spread(std::span<const SE3> poses) {
  Vector3d mean = Vector3d::Zero();
  for (const SE3& pose : poses) mean += pose.translation() / static_cast<double>(poses.size());
  double sum = 0.0;
  for (const SE3& pose : poses) sum += (pose.translation() - mean).squaredNorm();
  return std::sqrt(sum / static_cast<double>(poses.size()));
}

// Positions, and the ends of the axes of each camera.
std::vector<Vector3d> Marks(std::span<const SE3> poses, double axis) {
  std::vector<Vector3d> marks;
  for (const SE3& pose : poses) {
    marks.push_back(pose.translation());
    for (int k = 0; k < 3; ++k) marks.push_back(pose * Vector3d(axis * Vector3d::Unit(k)));
  }
  return marks;
}

std::optional<Sim3> MapFromDirect(std::span<const TrajectoryKeyframe> segment) {
  std::vector<SE3> in_map, in_direct;
  for (const TrajectoryKeyframe& keyframe : segment) {
    if (!keyframe.located) continue;
    in_map.push_back(keyframe.map_from_camera);
    in_direct.push_back(keyframe.direct_from_camera);
  }
  if (in_map.size() < 3) return std::nullopt;
  const double map_spread = Spread(in_map), direct_spread = Spread(in_direct);
  if (!(map_spread > 0.0) || !(direct_spread > 0.0)) return std::nullopt;
  const auto aligned =
      AlignPoints(Marks(in_map, kAxisShare * map_spread), Marks(in_direct, kAxisShare * direct_spread));
  if (!aligned.ok()) return std::nullopt;
  return aligned->a_from_b;
}

}  // namespace

std::vector<TrajectoryKeyframe> WithDirectStretches(const std::vector<TrajectoryKeyframe>& refined,
                                                    std::span<const Stretch> stretches) {
  std::vector<TrajectoryKeyframe> mixed = refined;
  const std::span<const TrajectoryKeyframe> all(refined);
  for (const Stretch& stretch : stretches) {
    const std::size_t begin = stretch.begin, end = stretch.end;
    const auto map_from_direct = MapFromDirect(all.subspan(begin, end - begin));
    if (!map_from_direct) continue;
    const auto continues = [&](std::size_t beside) {
      return refined[beside].located && refined[beside].segment == refined[begin].segment;
    };
    const bool has_before = begin > 0 && continues(begin - 1), has_after = end < refined.size() && continues(end);
    double scale = map_from_direct->scale();
    if (has_before && has_after) {
      // What the map makes of the stretch is in doubt, what it makes of both sides is not.
      std::size_t first = begin, last = end;
      while (first > 0 && begin - first < kBeside && continues(first - 1)) --first;
      while (last < refined.size() && last - end < kBeside && continues(last)) ++last;
      const auto before = MapFromDirect(all.subspan(first, begin - first));
      const auto after = MapFromDirect(all.subspan(end, last - end));
      if (before && after) scale = std::sqrt(before->scale() * after->scale());
    }
    for (std::size_t i = begin; i < end; ++i) {
      mixed[i].map_from_camera = map_from_direct->TransformPose(mixed[i].direct_from_camera);
      mixed[i].map_per_direct = scale;
      mixed[i].located = true;
    }
    FillByDirectMotion(mixed, begin, end, has_before, has_after);
  }
  return mixed;
}

std::vector<KeyframeRotation> DirectRotations(const std::vector<KeyframeTrajectory::Entry>& entries,
                                              const map::Snapshot& map) {
  std::vector<KeyframeRotation> rotations;
  const KeyframeTrajectory::Entry* before = nullptr;
  int steps = 0;
  for (const KeyframeTrajectory::Entry& entry : entries) {
    ++steps;
    if (!entry.keyframe || !map.keyframes().Contains(entry.keyframe)) continue;
    if (before != nullptr && before->segment == entry.segment) {
      const Quaterniond b_from_a =
          entry.direct_from_camera.rotation().conjugate() * before->direct_from_camera.rotation();
      rotations.push_back({before->keyframe, entry.keyframe, b_from_a, steps});
    }
    before = &entry;
    steps = 0;
  }
  return rotations;
}

}  // namespace cairn::mapping
