#include "tracking/map_bend.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "geometry/alignment.h"

namespace cairn::tracking {
namespace {

constexpr int kNeighbours = 12;  // with 6 and 30 much the same comes out (docs/deviations.md)
constexpr std::size_t kFewest = 4;
constexpr double kSimilarityFreedom = 7.0, kRotationFreedom = 3.0;

// Nothing was corrected between the two but what adjustment moves: of a loop they are in the same half.
bool OnOneSide(const std::vector<map::ClosedLoop>& loops, TimeNs a, TimeNs b) {
  return std::ranges::all_of(loops, [&](const map::ClosedLoop& loop) {
    const TimeNs middle = loop.loop_time_ns + (loop.keyframe_time_ns - loop.loop_time_ns) / 2;
    return (a < middle) == (b < middle);
  });
}

std::vector<const map::Keyframe*> Around(const map::Snapshot& map, const map::Keyframe& keyframe) {
  std::vector<const map::Keyframe*> around = {&keyframe};
  const auto session = map.sessions().find(keyframe.session);
  for (const KeyframeId id : map::BestCovisible(keyframe, kNeighbours)) {
    const map::Keyframe* other = map.keyframes().Find(id);
    if (other == nullptr || other->session != keyframe.session || other->direct_segment != keyframe.direct_segment) {
      continue;
    }
    if (session != map.sessions().end() && !OnOneSide(session->second.loops, keyframe.time_ns, other->time_ns))
      continue;
    around.push_back(other);
  }
  return around;
}

// The variance per axis of what turns the keyframes differently, after the rotation that most of it is.
double RotationVariance(const std::vector<const map::Keyframe*>& keyframes) {
  std::vector<Quaterniond> map_from_direct;
  Eigen::Vector4d sum = Eigen::Vector4d::Zero();
  for (const map::Keyframe* keyframe : keyframes) {
    const Quaterniond q = keyframe->camera_from_map.rotation().conjugate() * keyframe->camera_from_direct.rotation();
    sum += sum.dot(q.coeffs()) < 0.0 ? Eigen::Vector4d(-q.coeffs()) : Eigen::Vector4d(q.coeffs());
    map_from_direct.push_back(q);
  }
  const Quaterniond mean = Quaterniond(sum).normalized();
  double squares = 0.0;
  for (const Quaterniond& q : map_from_direct) squares += std::pow(AngleRad(mean.conjugate() * q), 2);
  return squares / (3.0 * static_cast<double>(keyframes.size()) - kRotationFreedom);
}

}  // namespace

MapError BendAround(const map::Snapshot& map, KeyframeId keyframe) {
  const map::Keyframe* middle = map.keyframes().Find(keyframe);
  if (middle == nullptr || middle->direct_segment < 0) return {};
  const std::vector<const map::Keyframe*> around = Around(map, *middle);
  if (around.size() < kFewest) return {};
  std::vector<Vector3d> in_map, in_direct;
  for (const map::Keyframe* one : around) {
    in_map.push_back(one->CenterInMap());
    in_direct.push_back(one->camera_from_direct.Inverse().translation());
  }
  const auto aligned = AlignPoints(in_map, in_direct, {.allow_collinear = true});
  if (!aligned.ok()) return {};  // the camera stood still: there is nothing to compare
  const auto count = static_cast<double>(around.size());
  const double variance = aligned->rmse * aligned->rmse * count / (3.0 * count - kSimilarityFreedom);
  return {std::sqrt(variance), std::sqrt(RotationVariance(around))};
}

MapError Larger(const MapError& a, const MapError& b) {
  return {std::max(a.translation, b.translation), std::max(a.rotation_rad, b.rotation_rad)};
}

}  // namespace cairn::tracking
