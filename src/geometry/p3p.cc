#include "geometry/p3p.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace cairn {
namespace {

constexpr int kPolishIterations = 2;
constexpr double kMinSine = 1e-7;  // of the angle between two sides of the triangle

// The pairs of rays whose points are `a` apart: |l_i y_i - l_j y_j|^2 = a, in the lengths l.
constexpr std::array<std::array<int, 2>, 3> kPairs = {{{0, 1}, {0, 2}, {1, 2}}};

// l^T M l = a for one pair.
Matrix3d PairForm(int pair, double cosine) {
  const auto [i, j] = kPairs[static_cast<std::size_t>(pair)];
  Matrix3d form = Matrix3d::Zero();
  form(i, i) = form(j, j) = 1.0;
  form(i, j) = form(j, i) = -cosine;
  return form;
}

// One real root of c3 x^3 + c2 x^2 + c1 x + c0, c3 not 0: in closed form, then by Newton's method.
double CubicRoot(double c3, double c2, double c1, double c0) {
  const double a = c2 / c3, b = c1 / c3, c = c0 / c3;
  const double shift = a / 3.0;
  const double p = b - a * shift, q = 2.0 * shift * shift * shift - shift * b + c;
  const double discriminant = 0.25 * q * q + p * p * p / 27.0;
  double x = 0.0;
  if (discriminant >= 0.0) {
    const double root = std::sqrt(discriminant);
    // The larger of the two cube roots is free of cancellation; the other follows from it.
    const double u = std::cbrt(q > 0.0 ? -0.5 * q - root : -0.5 * q + root);
    x = u == 0.0 ? 0.0 : u - p / (3.0 * u);
  } else {
    const double radius = std::sqrt(-p / 3.0);
    x = 2.0 * radius * std::cos(std::acos(std::clamp(1.5 * q / (p * radius), -1.0, 1.0)) / 3.0);
  }
  x -= shift;
  for (int i = 0; i < kPolishIterations; ++i) {
    const double slope = (3.0 * x + 2.0 * a) * x + b;
    if (slope == 0.0) break;
    x -= (((x + a) * x + b) * x + c) / slope;
  }
  return x;
}

// det(A + x B) as a cubic in x has these columns' determinants as coefficients.
double Determinant(const Vector3d& a, const Vector3d& b, const Vector3d& c) { return a.dot(b.cross(c)); }

class TriangleSolver {
 public:
  TriangleSolver(const P3PRays& rays, const P3PPoints& points, P3PPoses* poses)
      : rays_(rays), points_(points), poses_(*poses) {
    for (int k = 0; k < 3; ++k) {
      const auto [i, j] = kPairs[static_cast<std::size_t>(k)];
      form_[k] = PairForm(k, rays[i].dot(rays[j]));
      squared_[k] = (points[i] - points[j]).squaredNorm();
    }
  }

  int Solve() {
    const Vector3d side = points_[0] - points_[1], other = points_[0] - points_[2], normal = side.cross(other);
    if (!(normal.norm() > kMinSine * side.norm() * other.norm())) return 0;
    Matrix3d triangle;
    triangle << side, other, normal;
    triangle_inverse_ = triangle.inverse();
    // Two forms that are 0 at the solution; a member of their pencil that is singular.
    const Matrix3d first = form_[0] * squared_[2] - form_[2] * squared_[0];
    const Matrix3d second = form_[1] * squared_[2] - form_[2] * squared_[1];
    const Matrix3d &a = first, &b = second;
    const double c3 = b.determinant(), c0 = a.determinant();
    const double c2 = Determinant(a.col(0), b.col(1), b.col(2)) + Determinant(b.col(0), a.col(1), b.col(2)) +
                      Determinant(b.col(0), b.col(1), a.col(2));
    const double c1 = Determinant(b.col(0), a.col(1), a.col(2)) + Determinant(a.col(0), b.col(1), a.col(2)) +
                      Determinant(a.col(0), a.col(1), b.col(2));
    // The root may be infinite in one of the two ways to write the pencil.
    if (std::abs(c3) >= std::abs(c0)) {
      if (c3 == 0.0) return 0;
      Split(a + CubicRoot(c3, c2, c1, c0) * b, b);
    } else {
      Split(b + CubicRoot(c0, c1, c2, c3) * a, a);
    }
    return count_;
  }

 private:
  // The two planes of lengths in which the singular form is 0.
  void Split(const Matrix3d& singular, const Matrix3d& another) {
    Eigen::SelfAdjointEigenSolver<Matrix3d> eigen;
    eigen.computeDirect(singular);
    const double negative = eigen.eigenvalues()[0], positive = eigen.eigenvalues()[2];
    if (!(negative < 0.0 && positive > 0.0)) return;
    const double ratio = std::sqrt(-negative / positive);
    for (const double sign : {1.0, -1.0}) {
      InPlane(eigen.eigenvectors().col(2) + sign * ratio * eigen.eigenvectors().col(0), another);
    }
  }

  // Lengths l with normal . l = 0 and l^T form l = 0: two lines through the origin.
  void InPlane(const Vector3d& normal, const Matrix3d& form) {
    int k = 0;
    normal.cwiseAbs().maxCoeff(&k);
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    if (normal[k] == 0.0) return;
    // l = l_i (p + t q), t = l_j / l_i.
    Vector3d p = Vector3d::Zero(), q = Vector3d::Zero();
    p[i] = q[j] = 1.0;
    p[k] = -normal[i] / normal[k];
    q[k] = -normal[j] / normal[k];
    const double a = q.dot(form * q), b = p.dot(form * q), c = p.dot(form * p);
    const double discriminant = b * b - a * c;
    if (!(discriminant >= 0.0)) return;
    const double root = std::sqrt(discriminant);
    const double larger = b > 0.0 ? -b - root : -b + root;  // free of cancellation
    if (a != 0.0) AlongLine(p + larger / a * q);
    if (larger != 0.0) AlongLine(p + c / larger * q);
  }

  void AlongLine(const Vector3d& direction) {
    if (!(direction.minCoeff() > 0.0)) return;  // a point behind the camera
    int longest = 0;
    squared_.maxCoeff(&longest);
    const double unit = direction.dot(form_[longest] * direction);
    if (!(unit > 0.0) || count_ == 4) return;
    Vector3d lengths = std::sqrt(squared_[longest] / unit) * direction;
    for (int iteration = 0; iteration < kPolishIterations; ++iteration) {
      Vector3d error;
      Matrix3d jacobian;
      for (int k = 0; k < 3; ++k) {
        const Vector3d gradient = form_[k] * lengths;
        error[k] = lengths.dot(gradient) - squared_[k];
        jacobian.row(k) = 2.0 * gradient.transpose();
      }
      const Vector3d step = jacobian.inverse() * error;
      if (!step.allFinite()) break;
      lengths -= step;
    }
    if (lengths.allFinite() && lengths.minCoeff() > 0.0) AddPose(lengths);
  }

  void AddPose(const Vector3d& lengths) {
    std::array<Vector3d, 3> seen;
    for (std::size_t i = 0; i < 3; ++i) seen[i] = lengths[static_cast<int>(i)] * rays_[i];
    const Vector3d side = seen[0] - seen[1], other = seen[0] - seen[2];
    Matrix3d triangle;
    triangle << side, other, side.cross(other);
    const Quaterniond rotation = Quaterniond(triangle * triangle_inverse_).normalized();
    if (!rotation.coeffs().allFinite()) return;
    poses_[static_cast<std::size_t>(count_++)] = SE3(rotation, seen[0] - rotation * points_[0]);
  }

  const P3PRays& rays_;
  const P3PPoints& points_;
  P3PPoses& poses_;
  std::array<Matrix3d, 3> form_;
  Vector3d squared_;
  Matrix3d triangle_inverse_;
  int count_ = 0;
};

}  // namespace

int SolveP3P(const P3PRays& rays, const P3PPoints& points, P3PPoses* poses) {
  return TriangleSolver(rays, points, poses).Solve();
}

}  // namespace cairn
