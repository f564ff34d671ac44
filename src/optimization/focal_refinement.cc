#include "optimization/focal_refinement.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace cairn::optimization {
namespace {

constexpr int kIterations = 10;
constexpr std::size_t kMinObservations = 8;
constexpr double kHuber = 2.4477;  // sqrt(5.991), whitened
constexpr double kMaxFactor = 8.0;
constexpr double kMinPivot = 1e-9;  // of the normal matrix scaled to a unit diagonal

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;

Pinhole WithFocal(const Pinhole& pinhole, double factor) {
  Pinhole scaled = pinhole;
  scaled.fx_px *= factor;
  scaled.fy_px *= factor;
  return scaled;
}

struct Normal {
  Matrix7d hessian = Matrix7d::Zero();
  Vector7d gradient = Vector7d::Zero();
  double chi2 = 0.0;  // robust
};

Normal Linearize(const Pinhole& pinhole, const SE3& pose, std::span<const PoseObservation> observations) {
  Normal normal;
  const HuberLoss loss{kHuber};
  for (const PoseObservation& observation : observations) {
    const Vector3d point_c = pose * observation.point;
    if (!InFront(point_c)) continue;
    const double information = 1.0 / (observation.sigma_px * observation.sigma_px);
    const Vector2d residual = ReprojectionResidual(pinhole, point_c, observation.pixel);
    const double chi2 = information * residual.squaredNorm();
    Eigen::Matrix<double, 2, 7> j;
    j.leftCols<6>() = ReprojectionByPose(pinhole, point_c);
    j.col(6) = pinhole.Project(point_c) - Vector2d(pinhole.cx_px, pinhole.cy_px);
    const double weight = information * loss.Weight(chi2);
    normal.hessian.noalias() += weight * j.transpose() * j;
    normal.gradient.noalias() += weight * j.transpose() * residual;
    normal.chi2 += loss.Value(chi2);
  }
  return normal;
}

}  // namespace

absl::StatusOr<FocalRefinement> RefineFocal(const Pinhole& pinhole, const SE3& camera_from_map,
                                            std::span<const PoseObservation> observations) {
  if (observations.size() < kMinObservations) {
    return absl::FailedPreconditionError(
        absl::StrCat("focal length: ", observations.size(), " matches, at least ", kMinObservations, " needed"));
  }
  FocalRefinement result;
  result.camera_from_map = camera_from_map;
  Normal normal = Linearize(pinhole, camera_from_map, observations);
  result.chi2_before = normal.chi2;
  Matrix7d inverse = Matrix7d::Zero();
  double damping = 1e-4;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const Vector7d diagonal = normal.hessian.diagonal();
    if (!(diagonal.minCoeff() > 0.0)) return absl::FailedPreconditionError("focal length: the matches leave it open");
    const Vector7d scale = diagonal.cwiseSqrt().cwiseInverse();
    Matrix7d scaled = scale.asDiagonal() * normal.hessian * scale.asDiagonal();
    const Eigen::LDLT<Matrix7d> exact(scaled);
    if (exact.info() != Eigen::Success || exact.vectorD().minCoeff() < kMinPivot) {
      return absl::FailedPreconditionError("focal length: the matches leave it open");
    }
    inverse = scale.asDiagonal() * exact.solve(Matrix7d::Identity()) * scale.asDiagonal();
    scaled.diagonal().array() += damping;
    const Vector7d step = -(scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * normal.gradient)).eval();
    const double factor = result.factor * std::exp(std::clamp(step[6], -0.5, 0.5));
    if (!step.allFinite() || factor > kMaxFactor || factor < 1.0 / kMaxFactor) {
      return absl::FailedPreconditionError("focal length: the matches leave it open");
    }
    const SE3 pose = SE3::Exp(step.head<6>()) * result.camera_from_map;
    const Normal next = Linearize(WithFocal(pinhole, factor), pose, observations);
    if (next.chi2 > normal.chi2) {
      damping *= 10.0;
      continue;
    }
    damping *= 0.1;
    const bool converged = normal.chi2 - next.chi2 < 1e-6 * (1.0 + next.chi2);
    result.camera_from_map = pose;
    result.factor = factor;
    normal = next;
    if (converged) break;
  }
  result.chi2 = normal.chi2;
  const double freedom = std::max(1.0, 2.0 * static_cast<double>(observations.size()) - 7.0);
  result.factor_sigma = result.factor * std::sqrt(inverse(6, 6) * std::max(1.0, normal.chi2 / freedom));
  return result;
}

}  // namespace cairn::optimization
