#include "synth/walk.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace cairn::synth {
namespace {

constexpr int kPerPiece = 64;  // samples of the length

}  // namespace

Walk::Walk(const std::vector<Waypoint>& waypoints) : points_(waypoints) {
  const int samples = (static_cast<int>(points_.size()) - 3) * kPerPiece;
  double length = 0.0;
  Vector3d last = AtParameter(0.0).position;
  for (int i = 0; i <= samples; ++i) {
    const Vector3d here = AtParameter(static_cast<double>(i) / kPerPiece).position;
    length += (here - last).norm();
    distances_.push_back(length);
    last = here;
  }
}

Walk::Step Walk::AtParameter(double t) const {
  const int pieces = static_cast<int>(points_.size()) - 3;
  const int piece = std::clamp(static_cast<int>(std::floor(t)), 0, pieces - 1);
  const double u = t - piece, v = 1.0 - u;
  const std::array<double, 4> value = {v * v * v / 6.0, (3 * u * u * u - 6 * u * u + 4) / 6.0,
                                       (3 * v * v * v - 6 * v * v + 4) / 6.0, u * u * u / 6.0};
  const std::array<double, 4> slope = {-0.5 * v * v, 1.5 * u * u - 2 * u, 2 * v - 1.5 * v * v, 0.5 * u * u};
  Step step;
  Vector3d ahead = Vector3d::Zero();
  for (std::size_t k = 0; k < 4; ++k) {
    const Waypoint& p = points_[static_cast<std::size_t>(piece) + k];
    step.position += value[k] * Vector3d(p.x_m, p.y_m, 0.0);
    ahead += slope[k] * Vector3d(p.x_m, p.y_m, 0.0);
    step.look_rad += value[k] * p.look_rad;
  }
  step.ahead = ahead.normalized();
  return step;
}

Walk::Step Walk::At(double distance_m) const {
  const double inside = std::clamp(distance_m, 0.0, length_m());
  const auto next = std::upper_bound(distances_.begin() + 1, distances_.end() - 1, inside);
  const double before = *(next - 1), share = (inside - before) / std::max(1e-12, *next - before);
  Step step = AtParameter((static_cast<double>(next - 1 - distances_.begin()) + share) / kPerPiece);
  step.position += (distance_m - inside) * step.ahead;
  return step;
}

}  // namespace cairn::synth
