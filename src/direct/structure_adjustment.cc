#include "direct/structure_adjustment.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace cairn::direct {
namespace {

constexpr double kBehindPenaltyPx2 = 100.0;

double HuberWeight(double squared_px2) {
  const double norm = std::sqrt(squared_px2);
  return norm <= kStructureHuberPx ? 1.0 : kStructureHuberPx / norm;
}

double HuberEnergy(double squared_px2) {
  const double w = HuberWeight(squared_px2);
  return w * squared_px2 * (2.0 - w);
}

bool Observed(const Vector2d& pixel) { return std::isfinite(pixel.x()); }

double Energy(const StructureProblem& problem) {
  double energy = 0.0;
  for (std::size_t v = 0; v < problem.camera_from_reference.size(); ++v) {
    for (std::size_t p = 0; p < problem.inverse_depth.size(); ++p) {
      if (!Observed(problem.observed_px[v][p])) continue;
      Vector2d r;
      const bool front =
          StructureResidual(problem.camera, problem.reference_px[p], problem.inverse_depth[p],
                            problem.camera_from_reference[v], problem.observed_px[v][p], &r, nullptr, nullptr);
      energy += front ? HuberEnergy(r.squaredNorm()) : kBehindPenaltyPx2;
    }
  }
  return energy;
}

// What fits at the current estimate.
StructureReport Report(const StructureProblem& problem) {
  const auto views = static_cast<Eigen::Index>(problem.camera_from_reference.size());
  const auto points = static_cast<Eigen::Index>(problem.inverse_depth.size());
  StructureReport report;
  report.inlier.assign(problem.inverse_depth.size(), false);
  report.relative_depth_sigma.assign(problem.inverse_depth.size(), 1e9);
  double sum = 0.0;
  int count = 0, inliers = 0;
  for (Eigen::Index p = 0; p < points; ++p) {
    double point_sum = 0.0, information = 0.0;
    int point_count = 0;
    bool front = problem.inverse_depth[p] > 0.0;
    for (Eigen::Index v = 0; v < views; ++v) {
      if (!Observed(problem.observed_px[v][p])) continue;
      Vector2d r, by_depth;
      Eigen::Matrix<double, 2, 6> j;
      if (!StructureResidual(problem.camera, problem.reference_px[p], problem.inverse_depth[p],
                             problem.camera_from_reference[v], problem.observed_px[v][p], &r, &j, &by_depth)) {
        front = false;
        continue;
      }
      point_sum += r.squaredNorm();
      information += by_depth.squaredNorm();
      ++point_count;
    }
    if (information > 0.0) {
      report.relative_depth_sigma[p] =
          1.0 / (std::sqrt(information) * std::max(std::abs(problem.inverse_depth[p]), 1e-9));
    }
    const double limit = 2.0 * kStructureHuberPx;
    if (!front || point_count == 0 || point_sum > limit * limit * point_count) continue;
    report.inlier[p] = true;
    ++inliers;
    sum += point_sum;
    count += point_count;
  }
  report.rms_px = count > 0 ? std::sqrt(sum / count) : 1e9;
  report.inlier_share = points > 0 ? static_cast<double>(inliers) / static_cast<double>(points) : 0.0;
  return report;
}

}  // namespace

bool StructureResidual(const Pinhole& camera, const Vector2d& reference_px, double inverse_depth, const SE3& pose,
                       const Vector2d& observed_px, Vector2d* residual, Eigen::Matrix<double, 2, 6>* by_pose,
                       Vector2d* by_depth) {
  // The point times its inverse depth: well behaved far away, and projection does not see the factor.
  const Vector3d point = pose.rotation() * camera.Unproject(reference_px) + inverse_depth * pose.translation();
  if (point.z() < 1e-6) return false;
  *residual = camera.Project(point) - observed_px;
  if (by_pose != nullptr) {
    const Eigen::Matrix<double, 2, 3> j = camera.ProjectJacobian(point);
    by_pose->leftCols<3>() = inverse_depth * j;
    by_pose->rightCols<3>() = -j * Hat(point);
    *by_depth = j * pose.translation();
  }
  return true;
}

double AlignView(const StructureProblem& problem, const std::vector<Vector2d>& observed_px, int iterations, SE3* pose) {
  double damping = 1e-4, last = 1e300;
  SE3 best = *pose;
  double rms = 1e9;
  for (int iteration = 0; iteration <= iterations; ++iteration) {
    Matrix6d h = Matrix6d::Zero();
    Vector6d b = Vector6d::Zero();
    double energy = 0.0, sum = 0.0;
    int count = 0;
    for (std::size_t p = 0; p < problem.inverse_depth.size(); ++p) {
      if (!Observed(observed_px[p])) continue;
      Vector2d r, by_depth;
      Eigen::Matrix<double, 2, 6> j;
      if (!StructureResidual(problem.camera, problem.reference_px[p], problem.inverse_depth[p], *pose, observed_px[p],
                             &r, &j, &by_depth)) {
        energy += kBehindPenaltyPx2;
        continue;
      }
      const double w = HuberWeight(r.squaredNorm());
      h += w * j.transpose() * j;
      b += w * j.transpose() * r;
      energy += HuberEnergy(r.squaredNorm());
      sum += w * r.squaredNorm();
      ++count;
    }
    if (energy < last) {
      last = energy, best = *pose, rms = std::sqrt(sum / std::max(1, count));
      damping *= 0.3;
    } else {
      damping *= 10.0;
    }
    h.diagonal() *= 1.0 + damping;
    h.diagonal().array() += 1e-9;
    const Vector6d step = -h.ldlt().solve(b);
    if (!step.allFinite()) break;
    *pose = SE3::Exp(step) * best;
    if (step.norm() < 1e-8) break;
  }
  *pose = best;
  return rms;
}

StructureReport AdjustStructure(int iterations, StructureProblem* problem) {
  const Eigen::Index views = static_cast<Eigen::Index>(problem->camera_from_reference.size());
  const Eigen::Index points = static_cast<Eigen::Index>(problem->inverse_depth.size());
  double energy = Energy(*problem), damping = 1e-4;
  Eigen::VectorXd h_depth(points), b_depth(points);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    Eigen::MatrixXd h = Eigen::MatrixXd::Zero(6 * views, 6 * views);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(6 * views);
    Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(6 * views, points);
    h_depth.setZero();
    b_depth.setZero();
    for (Eigen::Index v = 0; v < views; ++v) {
      for (Eigen::Index p = 0; p < points; ++p) {
        const Vector2d& observed = problem->observed_px[v][p];
        if (!Observed(observed)) continue;
        Vector2d r, by_depth;
        Eigen::Matrix<double, 2, 6> j;
        if (!StructureResidual(problem->camera, problem->reference_px[p], problem->inverse_depth[p],
                               problem->camera_from_reference[v], observed, &r, &j, &by_depth)) {
          continue;
        }
        const double w = HuberWeight(r.squaredNorm());
        h.block<6, 6>(6 * v, 6 * v) += w * j.transpose() * j;
        b.segment<6>(6 * v) += w * j.transpose() * r;
        rows.block<6, 1>(6 * v, p) = w * j.transpose() * by_depth;
        h_depth[p] += w * by_depth.squaredNorm();
        b_depth[p] += w * by_depth.dot(r);
      }
    }
    Eigen::MatrixXd reduced = h;
    reduced.diagonal() *= 1.0 + damping;
    reduced.diagonal().array() += 1e-9;
    Eigen::VectorXd damped(points);
    for (Eigen::Index p = 0; p < points; ++p) damped[p] = h_depth[p] * (1.0 + damping) + 1e-6;
    reduced.noalias() -= rows * damped.cwiseInverse().asDiagonal() * rows.transpose();
    const Eigen::VectorXd reduced_b = b - rows * b_depth.cwiseQuotient(damped);
    const Eigen::VectorXd step = -reduced.ldlt().solve(reduced_b);
    if (!step.allFinite()) break;
    const Eigen::VectorXd depth_step = -(b_depth + rows.transpose() * step).cwiseQuotient(damped);
    StructureProblem next = *problem;
    for (Eigen::Index v = 0; v < views; ++v) {
      next.camera_from_reference[v] = SE3::Exp(step.segment<6>(6 * v)) * problem->camera_from_reference[v];
    }
    for (Eigen::Index p = 0; p < points; ++p) next.inverse_depth[p] += depth_step[p];
    const double next_energy = Energy(next);
    if (next_energy < energy) {
      const bool small = energy - next_energy < 1e-5 * energy;
      *problem = std::move(next);
      energy = next_energy;
      damping = std::max(damping * 0.2, 1e-8);
      if (small) break;
    } else {
      damping *= 10.0;
      if (damping > 1e6) break;
    }
  }
  return Report(*problem);
}

StructureReport AdjustDepths(int iterations, StructureProblem* problem) {
  for (std::size_t p = 0; p < problem->inverse_depth.size(); ++p) {
    for (int iteration = 0; iteration < iterations; ++iteration) {
      double h = 1e-6, b = 0.0;
      for (std::size_t v = 0; v < problem->camera_from_reference.size(); ++v) {
        const Vector2d& observed = problem->observed_px[v][p];
        Vector2d r, by_depth;
        Eigen::Matrix<double, 2, 6> j;
        if (!Observed(observed) ||
            !StructureResidual(problem->camera, problem->reference_px[p], problem->inverse_depth[p],
                               problem->camera_from_reference[v], observed, &r, &j, &by_depth)) {
          continue;
        }
        const double w = HuberWeight(r.squaredNorm());
        h += w * by_depth.squaredNorm();
        b += w * by_depth.dot(r);
      }
      problem->inverse_depth[p] -= b / h;
    }
  }
  return Report(*problem);
}

}  // namespace cairn::direct
