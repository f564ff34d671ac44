#include "plot/projection.h"

#include <Eigen/Eigenvalues>
#include <cmath>
#include <numbers>

namespace cairn::plot {
namespace {

struct Spread {
  Vector3d mean = Vector3d::Zero();
  Matrix3d covariance = Matrix3d::Zero();
};

Spread ComputeSpread(std::span<const Vector3d> points) {
  Spread spread;
  if (points.empty()) return spread;
  for (const Vector3d& p : points) spread.mean += p;
  spread.mean /= static_cast<double>(points.size());
  for (const Vector3d& p : points) spread.covariance += (p - spread.mean) * (p - spread.mean).transpose();
  return spread;
}

// World axes with the given one towards the viewer. Seen along y the viewer looks in its direction: in a world that
// starts as a camera, y points down and this is from above.
Projection AlongWorldAxis(int normal, bool towards_viewer) {
  Projection p;
  const int right = normal == 0 ? 1 : 0, up = normal == 2 ? 1 : 2;
  p.names[0] = std::string(1, "xyz"[right]);
  p.names[1] = std::string(1, "xyz"[up]);
  p.names[2] = std::string(1, "xyz"[normal]);
  p.axes.setZero();
  p.axes(0, right) = 1.0;
  p.axes(1, up) = 1.0;
  p.axes.row(2) = p.axes.row(0).cross(p.axes.row(1));
  if (towards_viewer && p.axes(2, normal) < 0.0) {  // seen from the other side: turn the picture over
    p.axes.row(1) *= -1.0;
    p.axes.row(2) *= -1.0;
    p.names[1] = "\u2212" + p.names[1];
  }
  return p;
}

int ClosestWorldAxis(const Vector3d& direction, double* angle_deg) {
  Eigen::Index axis = 0;
  const double cosine = direction.normalized().cwiseAbs().maxCoeff(&axis);
  *angle_deg = std::acos(std::min(1.0, cosine)) * 180.0 / std::numbers::pi;
  return static_cast<int>(axis);
}

// The same picture from one run to the next: an axis points where its largest component is positive.
Vector3d Oriented(const Vector3d& v) {
  Eigen::Index axis = 0;
  v.cwiseAbs().maxCoeff(&axis);
  return v[axis] < 0.0 ? Vector3d(-v) : v;
}

}  // namespace

Projection PrincipalPlane(std::span<const Vector3d> points, double snap_deg) {
  const Spread spread = ComputeSpread(points);
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(spread.covariance);
  double angle_deg = 0.0;
  const int axis = ClosestWorldAxis(solver.eigenvectors().col(0), &angle_deg);
  // A path along a line has no plane; any of the world's axes across it will do.
  const bool is_line = solver.eigenvalues()[1] <= 1e-4 * solver.eigenvalues()[2];
  if (angle_deg <= snap_deg || is_line) return AlongWorldAxis(axis, false);
  Projection p;
  p.origin = spread.mean;
  const Vector3d right = Oriented(solver.eigenvectors().col(2)), up = Oriented(solver.eigenvectors().col(1));
  p.axes << right.transpose(), up.transpose(), right.cross(up).transpose();
  p.names[0] = "principal axis 1";
  p.names[1] = "principal axis 2";
  p.names[2] = "principal axis 3";
  return p;
}

Projection TopView(std::span<const Vector3d> points, const Vector3d& up) {
  double angle_deg = 0.0;
  const int axis = ClosestWorldAxis(up, &angle_deg);
  if (angle_deg < 5.0 && up[axis] > 0.0) return AlongWorldAxis(axis, true);
  if (angle_deg < 5.0) {
    Projection below = AlongWorldAxis(axis, true);
    below.axes.row(1) *= -1.0;
    below.axes.row(2) *= -1.0;
    below.names[1] =
        below.names[1].size() > 1 ? below.names[1].substr(std::string("\u2212").size()) : "\u2212" + below.names[1];
    return below;
  }
  const Spread spread = ComputeSpread(points);
  const Vector3d n = up.normalized();
  const Matrix3d flatten = Matrix3d::Identity() - n * n.transpose();
  const Eigen::SelfAdjointEigenSolver<Matrix3d> solver(flatten * spread.covariance * flatten);
  Vector3d right = flatten * solver.eigenvectors().col(2);
  if (right.norm() < 1e-9) right = n.unitOrthogonal();
  right = Oriented(right.normalized());
  Projection p;
  p.origin = spread.mean;
  p.axes << right.transpose(), n.cross(right).transpose(), n.transpose();
  p.names[0] = "right";
  p.names[1] = "forward";
  p.names[2] = "up";
  return p;
}

}  // namespace cairn::plot
