#include "geometry/alignment.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/median.h"
#include "base/random.h"

namespace cairn {
namespace {

struct Moments {
  double weight = 0.0;
  int count = 0;
  Vector3d mean_a = Vector3d::Zero();
  Vector3d mean_b = Vector3d::Zero();
  Matrix3d cross = Matrix3d::Zero();  // sum w (a - mean_a) (b - mean_b)^T
  Matrix3d cov_b = Matrix3d::Zero();  // sum w (b - mean_b) (b - mean_b)^T
  double variance_a = 0.0;            // sum w |a - mean_a|^2
};

Moments ComputeMoments(std::span<const Vector3d> a, std::span<const Vector3d> b, std::span<const double> w) {
  Moments m;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (w[i] == 0.0) continue;
    ++m.count;
    m.weight += w[i];
    m.mean_a += w[i] * a[i];
    m.mean_b += w[i] * b[i];
  }
  if (m.count == 0) return m;
  m.mean_a /= m.weight;
  m.mean_b /= m.weight;
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (w[i] == 0.0) continue;
    const Vector3d da = a[i] - m.mean_a, db = b[i] - m.mean_b;
    m.cross += w[i] * da * db.transpose();
    m.cov_b += w[i] * db * db.transpose();
    m.variance_a += w[i] * da.squaredNorm();
  }
  return m;
}

absl::Status CheckInput(std::span<const Vector3d> a, std::span<const Vector3d> b, std::span<const double> w) {
  if (a.size() != b.size() || a.size() != w.size()) {
    return absl::InvalidArgumentError(absl::StrCat("alignment needs as many points in a (", a.size(), ") as in b (",
                                                   b.size(), ") and as weights (", w.size(), ")"));
  }
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!a[i].allFinite() || !b[i].allFinite() || !std::isfinite(w[i]) || w[i] < 0.0) {
      return absl::InvalidArgumentError(
          absl::StrCat("alignment: pair ", i, " has a coordinate that is not finite or a negative weight"));
    }
  }
  return absl::OkStatus();
}

// Rounding leaves this share of a point's size in its difference to the mean.
bool IsCoincident(double variance, double weight, const Vector3d& mean) {
  const double floor = 1e-12 * (1e-12 + mean.norm());
  return variance <= weight * floor * floor;
}

absl::StatusOr<Alignment> Solve(std::span<const Vector3d> a, std::span<const Vector3d> b, std::span<const double> w,
                                const AlignmentOptions& options) {
  const Moments m = ComputeMoments(a, b, w);
  if (m.count < 3) {
    return absl::FailedPreconditionError(
        absl::StrCat("alignment needs at least 3 pairs of points with a weight, got ", m.count));
  }
  const double variance_b = m.cov_b.trace();
  if (IsCoincident(m.variance_a, m.weight, m.mean_a) || IsCoincident(variance_b, m.weight, m.mean_b)) {
    return absl::FailedPreconditionError("alignment: all points of one set coincide; rotation and scale are unknown");
  }

  const Eigen::JacobiSVD<Matrix3d> svd(m.cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Vector3d& d = svd.singularValues();
  Vector3d sign(1.0, 1.0, 1.0);
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0.0) sign[2] = -1.0;
  const double trace = d[0] + d[1] + sign[2] * d[2];
  // The rotation is unique only if the two smaller terms do not cancel (Umeyama's rank condition).
  const double across = d[1] + sign[2] * d[2];
  Alignment result;
  result.rotation_known = across > options.min_spread_ratio * options.min_spread_ratio * d[0];
  if (!result.rotation_known && !options.allow_collinear) {
    return absl::FailedPreconditionError(
        "alignment: the points lie on a line; scale and translation are known, the rotation about the line is not");
  }
  if (d[0] <= 1e-15 * std::sqrt(m.variance_a * variance_b)) {
    return absl::FailedPreconditionError("alignment: the two point sets are not correlated");
  }
  const Quaterniond rotation =
      result.rotation_known ? Quaterniond(Matrix3d(svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose()))
                            : Quaterniond::FromTwoVectors(svd.matrixV().col(0), svd.matrixU().col(0));
  const double scale = options.with_scale ? trace / variance_b : 1.0;
  result.a_from_b = Sim3(rotation, m.mean_a - scale * (rotation * m.mean_b), scale);

  double sum = 0.0;
  result.inlier.assign(a.size(), false);
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (w[i] == 0.0) continue;
    result.inlier[i] = true;
    sum += w[i] * (a[i] - result.a_from_b * b[i]).squaredNorm();
  }
  result.inlier_count = m.count;
  result.rmse = std::sqrt(sum / m.weight);
  // Weights are known up to a factor, so they are normalised to mean 1. In centred coordinates the normal equations of
  // scale, rotation and translation are decoupled.
  const double normalise = m.count / m.weight;
  const int freedom = 3 * m.count - (options.with_scale ? 7 : 6);
  const double variance = freedom > 0 ? normalise * sum / freedom : 0.0;
  if (options.with_scale) result.scale_sigma = std::sqrt(variance / (normalise * variance_b));
  if (result.rotation_known) {
    const Matrix3d information = normalise * scale * scale * (Matrix3d::Identity() * variance_b - m.cov_b);
    const double weakest = Eigen::SelfAdjointEigenSolver<Matrix3d>(information).eigenvalues()[0];
    result.rotation_sigma_rad =
        weakest > 0.0 ? std::min(std::sqrt(variance / weakest), std::numbers::pi) : std::numbers::pi;
  } else {
    result.rotation_sigma_rad = std::numbers::pi;
  }
  return result;
}

std::vector<double> Residuals(const Sim3& a_from_b, std::span<const Vector3d> a, std::span<const Vector3d> b) {
  std::vector<double> residuals(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) residuals[i] = (a[i] - a_from_b * b[i]).norm();
  return residuals;
}

struct Hypothesis {
  Sim3 a_from_b;
  double cost = std::numeric_limits<double>::infinity();
  bool found = false;
};

// RANSAC with the truncated quadratic cost (MSAC) when the threshold is known, else least median of squares.
Hypothesis Sample(std::span<const Vector3d> a, std::span<const Vector3d> b, const RobustAlignmentOptions& options) {
  Random random(options.seed);
  Hypothesis best;
  const std::size_t n = a.size();
  const double threshold = options.inlier_threshold;
  const std::array<double, 3> unit{1.0, 1.0, 1.0};
  double needed = options.max_samples;
  for (int k = 0; k < options.max_samples && k < needed; ++k) {
    std::array<std::size_t, 3> pick{};
    pick[0] = random.Below(n);
    do pick[1] = random.Below(n);
    while (pick[1] == pick[0]);
    do pick[2] = random.Below(n);
    while (pick[2] == pick[0] || pick[2] == pick[1]);
    const std::array<Vector3d, 3> sample_a{a[pick[0]], a[pick[1]], a[pick[2]]};
    const std::array<Vector3d, 3> sample_b{b[pick[0]], b[pick[1]], b[pick[2]]};
    const auto model = Solve(sample_a, sample_b, unit, options.alignment);
    if (!model.ok() || model->a_from_b.scale() <= 0.0) continue;
    std::vector<double> residuals = Residuals(model->a_from_b, a, b);
    double cost = 0.0;
    double inliers = 0.0;
    if (threshold > 0.0) {
      for (const double r : residuals) {
        cost += std::min(r * r, threshold * threshold);
        if (r <= threshold) inliers += 1.0;
      }
    } else {
      cost = Median(std::move(residuals));
    }
    if (cost >= best.cost) continue;
    best = {model->a_from_b, cost, true};
    if (threshold > 0.0) {
      const double good = std::pow(inliers / static_cast<double>(n), 3.0);
      if (good >= 1.0) break;
      if (good > 0.0) needed = std::log(1.0 - options.confidence) / std::log(1.0 - good);
    }
  }
  return best;
}

}  // namespace

absl::Status AlignmentOptions::Validate() const {
  if (!(min_spread_ratio >= 0.0 && min_spread_ratio < 1.0)) {
    return absl::InvalidArgumentError(absl::StrCat("min_spread_ratio must be in [0, 1), is ", min_spread_ratio));
  }
  return absl::OkStatus();
}

absl::Status RobustAlignmentOptions::Validate() const {
  CAIRN_RETURN_IF_ERROR(alignment.Validate());
  if (!(inlier_threshold >= 0.0) || !std::isfinite(inlier_threshold)) {
    return absl::InvalidArgumentError(absl::StrCat("inlier_threshold must not be negative, is ", inlier_threshold));
  }
  if (max_samples < 1) return absl::InvalidArgumentError("max_samples must be at least 1");
  if (!(confidence > 0.0 && confidence < 1.0)) return absl::InvalidArgumentError("confidence must be in (0, 1)");
  if (reweighting_iterations < 0) return absl::InvalidArgumentError("reweighting_iterations must not be negative");
  if (min_inliers < 3) return absl::InvalidArgumentError("min_inliers must be at least 3");
  return absl::OkStatus();
}

absl::StatusOr<Alignment> AlignPoints(std::span<const Vector3d> points_a, std::span<const Vector3d> points_b,
                                      const AlignmentOptions& options) {
  return AlignPointsWeighted(points_a, points_b, std::vector<double>(points_a.size(), 1.0), options);
}

absl::StatusOr<Alignment> AlignPointsWeighted(std::span<const Vector3d> points_a, std::span<const Vector3d> points_b,
                                              std::span<const double> weights, const AlignmentOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(CheckInput(points_a, points_b, weights));
  return Solve(points_a, points_b, weights, options);
}

absl::StatusOr<Alignment> AlignPointsRobust(std::span<const Vector3d> points_a, std::span<const Vector3d> points_b,
                                            const RobustAlignmentOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  const std::size_t n = points_a.size();
  std::vector<double> weights(n, 1.0);
  CAIRN_RETURN_IF_ERROR(CheckInput(points_a, points_b, weights));
  // Says so when even all of the pairs together do not determine the answer.
  CAIRN_RETURN_IF_ERROR(Solve(points_a, points_b, weights, options.alignment).status());

  const Hypothesis best = Sample(points_a, points_b, options);
  if (!best.found) {
    return absl::FailedPreconditionError("robust alignment: no sample of 3 pairs determines the transform");
  }
  std::vector<double> residuals = Residuals(best.a_from_b, points_a, points_b);
  double threshold = options.inlier_threshold;
  if (threshold == 0.0) {
    // 1.4826 makes the median a standard deviation; the factor in brackets is Rousseeuw's correction for small n. The
    // floor keeps exact data from calling its rounding errors outliers.
    double extent = 0.0;
    for (const Vector3d& p : points_a) extent = std::max(extent, p.norm());
    const double sigma = 1.4826 * (1.0 + 5.0 / std::max(1.0, static_cast<double>(n) - 3.0)) * Median(residuals);
    threshold = std::max(2.5 * sigma, 1e-9 * extent);
  }

  Sim3 a_from_b = best.a_from_b;
  std::vector<bool> inlier(n, false);
  absl::StatusOr<Alignment> result = absl::InternalError("no iteration");
  for (int k = 0; k <= options.reweighting_iterations; ++k) {
    int count = 0;
    for (std::size_t i = 0; i < n; ++i) {
      inlier[i] = residuals[i] <= threshold;
      // Cauchy with its scale at half the threshold: gently falling inside, nothing outside.
      const double u = 2.0 * residuals[i] / threshold;
      weights[i] = inlier[i] ? 1.0 / (1.0 + u * u) : 0.0;
      if (inlier[i]) ++count;
    }
    if (count < options.min_inliers) {
      return absl::FailedPreconditionError(absl::StrCat("robust alignment: only ", count, " of ", n,
                                                        " pairs agree within ", threshold, ", need ",
                                                        options.min_inliers));
    }
    result = Solve(points_a, points_b, weights, options.alignment);
    if (!result.ok()) return Annotate(result.status(), "robust alignment, inliers only");
    const Sim3 change = result->a_from_b.Inverse() * a_from_b;
    a_from_b = result->a_from_b;
    residuals = Residuals(a_from_b, points_a, points_b);
    if (change.Log().norm() < 1e-12) break;
  }
  return result;
}

}  // namespace cairn
