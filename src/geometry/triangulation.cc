#include "geometry/triangulation.h"

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace cairn {
namespace {

// Two rows of [ray]x [R t], spanning the plane across the ray: for unit u, v with u, v, ray orthonormal, u' (R X + t) =
// 0.
Eigen::Matrix<double, 2, 4> RayRows(const Vector3d& unit_ray, const Matrix3d& rotation, const Vector3d& translation) {
  const Vector3d u = unit_ray.unitOrthogonal();
  const Vector3d v = unit_ray.cross(u);
  Eigen::Matrix<double, 2, 4> rows;
  rows << u.transpose() * rotation, u.dot(translation), v.transpose() * rotation, v.dot(translation);
  return rows;
}

}  // namespace

std::optional<Vector3d> TriangulateViews(std::span<const SE3> camera_from_world, std::span<const Vector3d> rays) {
  const std::size_t n = camera_from_world.size();
  if (n < 2 || rays.size() != n) return std::nullopt;
  // Move the origin between the cameras and make their spread the unit, so that the system is well scaled.
  std::vector<Vector3d> centres(n);
  Vector3d middle = Vector3d::Zero();
  for (std::size_t i = 0; i < n; ++i) middle += centres[i] = camera_from_world[i].Inverse().translation();
  middle /= static_cast<double>(n);
  double spread = 0.0;
  for (const Vector3d& centre : centres) spread = std::max(spread, (centre - middle).norm());
  if (!(spread > 0.0) || !std::isfinite(spread)) return std::nullopt;

  Eigen::Matrix<double, Eigen::Dynamic, 4> rows(2 * n, 4);
  for (std::size_t i = 0; i < n; ++i) {
    const double length = rays[i].norm();
    if (!(length > 0.0) || !std::isfinite(length)) return std::nullopt;
    const Matrix3d rotation = camera_from_world[i].RotationMatrix();
    rows.middleRows<2>(2 * i) = RayRows(rays[i] / length, rotation, rotation * (middle - centres[i]) / spread);
  }
  const Eigen::JacobiSVD<Eigen::Matrix<double, Eigen::Dynamic, 4>> svd(rows, Eigen::ComputeFullV);
  // A second null direction: the rays lie on one line through the cameras, no depth follows.
  if (!(svd.singularValues()[2] > 1e-12 * svd.singularValues()[0])) return std::nullopt;
  const Eigen::Vector4d x = svd.matrixV().col(3);
  if (!(std::abs(x[3]) > 1e-12 * x.head<3>().norm())) return std::nullopt;
  const Vector3d point = x.head<3>() / x[3] * spread + middle;
  for (std::size_t i = 0; i < n; ++i) {
    if (!((camera_from_world[i] * point).dot(rays[i]) > 0.0)) return std::nullopt;
  }
  return point;
}

std::optional<Vector3d> TriangulateTwoView(const SE3& b_from_a, const Vector3d& ray_a, const Vector3d& ray_b) {
  const std::array<SE3, 2> cameras = {SE3(), b_from_a};
  const std::array<Vector3d, 2> rays = {ray_a, ray_b};
  return TriangulateViews(cameras, rays);
}

double AngleBetweenRad(const Vector3d& a, const Vector3d& b) { return std::atan2(a.cross(b).norm(), a.dot(b)); }

double ParallaxRad(const Vector3d& point, const Vector3d& centre_a, const Vector3d& centre_b) {
  return AngleBetweenRad(centre_a - point, centre_b - point);
}

}  // namespace cairn
