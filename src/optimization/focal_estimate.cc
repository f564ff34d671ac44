#include "optimization/focal_estimate.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace cairn::optimization {
namespace {

using Matrix7d = Eigen::Matrix<double, 7, 7>;
using Vector7d = Eigen::Matrix<double, 7, 1>;

constexpr int kLeastInliers = 30;
constexpr double kBehind = 1e6;  // chi-square of a point behind the camera

struct FocalState {
  SE3 camera_from_map;
  double log_scale = 0.0;

  Pinhole Scaled(const Pinhole& pinhole) const {
    Pinhole scaled = pinhole;
    scaled.fx_px *= std::exp(log_scale);
    scaled.fy_px *= std::exp(log_scale);
    return scaled;
  }
};

struct FocalEquations {
  Matrix7d hessian = Matrix7d::Zero();
  Vector7d gradient = Vector7d::Zero();
  double cost = 0.0;
};

double ChiSquareOf(const Pinhole& pinhole, const SE3& camera_from_map, const PoseObservation& observation) {
  const Vector3d point_c = camera_from_map * observation.point;
  if (!InFront(point_c)) return kBehind;
  const Vector2d residual = ReprojectionResidual(pinhole, point_c, observation.pixel);
  return std::min(kBehind, residual.squaredNorm() / (observation.sigma_px * observation.sigma_px));
}

FocalEquations LinearizeAt(const Pinhole& pinhole, const FocalState& state,
                           std::span<const PoseObservation> observations, std::span<const std::uint8_t> inlier,
                           const HuberLoss& loss) {
  FocalEquations sum;
  const Pinhole scaled = state.Scaled(pinhole);
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!inlier[i]) continue;
    const PoseObservation& observation = observations[i];
    const double chi2 = ChiSquareOf(scaled, state.camera_from_map, observation);
    sum.cost += loss.Value(chi2);
    if (chi2 >= kBehind) continue;
    const Vector3d point_c = state.camera_from_map * observation.point;
    Eigen::Matrix<double, 2, 7> j;
    j.leftCols<6>() = ReprojectionByPose(scaled, point_c);
    j.col(6) = ReprojectionByLogFocal(scaled, point_c);
    const double weight = loss.Weight(chi2) / (observation.sigma_px * observation.sigma_px);
    sum.hessian.noalias() += weight * j.transpose() * j;
    sum.gradient.noalias() += weight * j.transpose() * ReprojectionResidual(scaled, point_c, observation.pixel);
  }
  return sum;
}

void MinimizeWithFocal(const Pinhole& pinhole, std::span<const PoseObservation> observations,
                       std::span<const std::uint8_t> inlier, const HuberLoss& loss, int iterations, FocalState* state) {
  double damping = 1e-4;
  FocalEquations equations = LinearizeAt(pinhole, *state, observations, inlier, loss);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    Matrix7d damped = equations.hessian;
    damped.diagonal() *= 1.0 + damping;
    const Vector7d step = -damped.ldlt().solve(equations.gradient);
    if (!step.allFinite()) return;
    FocalState trial = *state;
    trial.camera_from_map = SE3::Exp(step.head<6>()) * trial.camera_from_map;
    trial.log_scale += std::clamp(step[6], -0.3, 0.3);
    const FocalEquations there = LinearizeAt(pinhole, trial, observations, inlier, loss);
    if (there.cost > equations.cost) {
      damping *= 10.0;
      if (damping > 1e8) return;
      continue;
    }
    const bool converged = equations.cost - there.cost < 1e-9 * (1.0 + equations.cost);
    *state = trial;
    equations = there;
    damping = std::max(1e-9, 0.1 * damping);
    if (converged) return;
  }
}

}  // namespace

bool FocalEstimate::Contradicts() const {
  constexpr double kSigmas = 5.0, kLeast = 0.02;
  return std::abs(std::log(scale)) > std::max(kSigmas * log_sigma, kLeast);
}

absl::StatusOr<FocalEstimate> EstimateFocal(const Pinhole& pinhole, const SE3& camera_from_map,
                                            std::span<const PoseObservation> observations,
                                            const PoseRefinementOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  for (const PoseObservation& o : observations) {
    if (!o.point.allFinite() || !o.pixel.allFinite() || !(o.sigma_px > 0.0) || !std::isfinite(o.sigma_px)) {
      return absl::InvalidArgumentError("focal length: an observation is not finite or has no positive sigma_px");
    }
  }
  const HuberLoss loss{options.huber_threshold};
  FocalState state{camera_from_map, 0.0};
  std::vector<std::uint8_t> inlier(observations.size(), 1);
  FocalEstimate estimate;
  double chi2 = 0.0;
  for (int round = 0; round < options.rounds; ++round) {
    MinimizeWithFocal(pinhole, observations, inlier, loss, 2 * options.iterations_per_round, &state);
    const Pinhole scaled = state.Scaled(pinhole);
    estimate.num_inliers = 0;
    chi2 = 0.0;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const double own = ChiSquareOf(scaled, state.camera_from_map, observations[i]);
      inlier[i] = own <= options.chi2_threshold ? 1 : 0;
      if (!inlier[i]) continue;
      ++estimate.num_inliers;
      chi2 += own;
    }
    if (estimate.num_inliers < kLeastInliers) {
      return absl::FailedPreconditionError(absl::StrCat("focal length: ", estimate.num_inliers,
                                                        " matches agree, at least ", kLeastInliers, " are needed"));
    }
  }
  const FocalEquations final = LinearizeAt(pinhole, state, observations, inlier, HuberLoss{1e9});
  const Vector7d diagonal = final.hessian.diagonal();
  if (!(diagonal.minCoeff() > 0.0)) return absl::FailedPreconditionError("focal length: it is undetermined");
  const Vector7d scale = diagonal.cwiseSqrt().cwiseInverse();
  const Matrix7d scaled = scale.asDiagonal() * final.hessian * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix7d> eigen(scaled);
  if (eigen.info() != Eigen::Success || eigen.eigenvalues()[0] < 1e-10 * eigen.eigenvalues()[6]) {
    return absl::FailedPreconditionError("focal length: it is undetermined");
  }
  const Matrix7d inverse =
      eigen.eigenvectors() * eigen.eigenvalues().cwiseInverse().asDiagonal() * eigen.eigenvectors().transpose();
  const double factor = std::max(1.0, chi2 / std::max(1.0, 2.0 * estimate.num_inliers - 7.0));
  estimate.log_sigma = std::sqrt(factor * inverse(6, 6)) * scale[6];
  estimate.scale = std::exp(state.log_scale);
  estimate.camera_from_map = state.camera_from_map;
  return estimate;
}

Matrix6d CoverFocal(const SE3& camera_from_map, const Matrix6d& covariance, const FocalEstimate& estimate) {
  const Vector6d apart = (estimate.camera_from_map * camera_from_map.Inverse()).Log();
  return covariance + apart * apart.transpose();
}

}  // namespace cairn::optimization
