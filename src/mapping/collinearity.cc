#include "mapping/collinearity.h"

#include <cmath>
#include <numbers>
#include <vector>

namespace cairn::mapping {

absl::Status CollinearityOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("collinearity: ", what)); };
  if (min_shared_points < 1) return bad("min_shared_points must be at least 1");
  if (!(min_angle_deg > 0.0 && min_angle_deg < 90.0)) return bad("min_angle_deg must be in (0, 90)");
  if (first_keyframes < 0) return bad("first_keyframes must not be negative");
  return absl::OkStatus();
}

bool LinksAreCollinear(const Vector3d& centre, std::span<const Vector3d> neighbour_centres, double min_angle_deg) {
  const double limit = std::cos(min_angle_deg * std::numbers::pi / 180.0);
  std::vector<Vector3d> directions;
  for (const Vector3d& neighbour : neighbour_centres) {
    const Vector3d link = neighbour - centre;
    if (link.norm() > 0.0) directions.push_back(link.normalized());
  }
  for (std::size_t i = 0; i < directions.size(); ++i) {
    for (std::size_t j = i + 1; j < directions.size(); ++j) {
      if (std::abs(directions[i].dot(directions[j])) <= limit) return false;
    }
  }
  return true;
}

bool CollinearityCounter::IsCollinear(const map::Snapshot& map, const map::Keyframe& keyframe) const {
  std::vector<Vector3d> neighbours;
  for (const map::CovisibilityEdge& edge : keyframe.covisible) {
    if (edge.shared_points < options_.min_shared_points) break;
    neighbours.push_back(map.keyframe(edge.keyframe).CenterInMap());
  }
  return LinksAreCollinear(keyframe.CenterInMap(), neighbours, options_.min_angle_deg);
}

void CollinearityCounter::Update(const map::Snapshot& map, KeyframeId id) {
  const map::Keyframe* keyframe = map.keyframes().Find(id);
  if (keyframe == nullptr) return;
  if (++keyframes_ > options_.first_keyframes && IsCollinear(map, *keyframe)) collinear_.insert(id);
  for (const map::CovisibilityEdge& edge : keyframe->covisible) {
    if (edge.shared_points < options_.min_shared_points) break;
    if (collinear_.contains(edge.keyframe) && !IsCollinear(map, map.keyframe(edge.keyframe))) {
      collinear_.erase(edge.keyframe);
    }
  }
}

}  // namespace cairn::mapping
