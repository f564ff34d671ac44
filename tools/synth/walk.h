// A walk past given points: a uniform cubic B-spline (smooth to the second derivative; it passes near its inner control
// points, not through them), measured along its length.
#pragma once

#include <vector>

#include "geometry/se3.h"

namespace cairn::synth {

class Walk {
 public:
  // Where one walks, and how far to the left of the way ahead one looks there.
  struct Waypoint {
    double x_m = 0.0;
    double y_m = 0.0;
    double look_rad = 0.0;
  };
  struct Step {
    Vector3d position = Vector3d::Zero();  // z = 0
    Vector3d ahead = Vector3d::UnitX();    // unit vector
    double look_rad = 0.0;
  };

  Walk() = default;
  // At least four points.
  explicit Walk(const std::vector<Waypoint>& waypoints);

  double length_m() const { return distances_.empty() ? 0.0 : distances_.back(); }
  // At a distance from the start; before the start and after the end one goes straight on.
  Step At(double distance_m) const;

 private:
  Step AtParameter(double t) const;  // in [0, points - 3]

  std::vector<Waypoint> points_;
  std::vector<double> distances_;  // at parameters i / kPerPiece
};

}  // namespace cairn::synth
