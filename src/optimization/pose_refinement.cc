#include "optimization/pose_refinement.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "optimization/normal_sum.h"

namespace cairn::optimization {
namespace {

struct NormalEquations {
  Matrix6d hessian = Matrix6d::Zero();
  Vector6d gradient = Vector6d::Zero();
  double cost = 0.0;
};

// A residual of a point that is not in front of the camera; large, but finite so that costs stay comparable.
constexpr double kBehindChi2 = 1e6;

double ChiSquare(const Pinhole& pinhole, const SE3& camera_from_map, const PoseObservation& observation) {
  const Vector3d point_c = camera_from_map * observation.point;
  if (!InFront(point_c)) return kBehindChi2;
  const double norm = ReprojectionResidual(pinhole, point_c, observation.pixel).squaredNorm();
  return std::min(kBehindChi2, norm / (observation.sigma_px * observation.sigma_px));
}

NormalEquations Linearize(const Pinhole& pinhole, const SE3& camera_from_map,
                          std::span<const PoseObservation> observations, std::span<const std::uint8_t> inlier,
                          const HuberLoss& loss) {
  NormalEquations sum;
  NormalSum squares;
  const Matrix3d rotation = camera_from_map.RotationMatrix();
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!inlier[i]) continue;
    const PoseObservation& observation = observations[i];
    const Vector3d point_c = rotation * observation.point + camera_from_map.translation();
    if (!InFront(point_c)) {
      sum.cost += loss.Value(kBehindChi2);
      continue;
    }
    const double information = 1.0 / (observation.sigma_px * observation.sigma_px);
    const Vector2d residual = ReprojectionResidual(pinhole, point_c, observation.pixel);
    const double chi2 = std::min(kBehindChi2, residual.squaredNorm() * information);
    sum.cost += loss.Value(chi2);
    const Matrix26d j = ReprojectionByPose(pinhole, point_c);
    const double weight = information * loss.Weight(chi2);
    squares.Add(weight, NormalSum::RowOf<6>(j.row(0), residual.x()), NormalSum::RowOf<6>(j.row(1), residual.y()));
  }
  sum.hessian = squares.Hessian<6>();
  sum.gradient = squares.Gradient<6>();
  return sum;
}

// Difference from the prior, Log(T T_prior^-1), whitened.
Vector6d PriorResidual(const PosePrior& prior, const SE3& camera_from_map) {
  Vector6d residual = (camera_from_map * prior.camera_from_map.Inverse()).Log();
  residual.head<3>() /= prior.translation_sigma;
  residual.tail<3>() /= prior.rotation_sigma_rad;
  return residual;
}

// Log(Exp(x) E) ~ Log(E) + x while E is near the identity, which a prior worth having makes sure of.
void AddPrior(const PosePrior& prior, const SE3& camera_from_map, NormalEquations* sum) {
  const Vector6d residual = PriorResidual(prior, camera_from_map);
  Vector6d weight;
  weight << Vector3d::Constant(1.0 / prior.translation_sigma), Vector3d::Constant(1.0 / prior.rotation_sigma_rad);
  sum->hessian.diagonal() += weight.cwiseAbs2();
  sum->gradient += weight.cwiseProduct(residual);
  sum->cost += residual.squaredNorm();
}

double Cost(const Pinhole& pinhole, const SE3& camera_from_map, std::span<const PoseObservation> observations,
            std::span<const std::uint8_t> inlier, const HuberLoss& loss) {
  double cost = 0.0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (inlier[i]) cost += loss.Value(ChiSquare(pinhole, camera_from_map, observations[i]));
  }
  return cost;
}

// Levenberg-Marquardt with Marquardt's scaling (Madsen, Nielsen, Tingleff, "Methods for non-linear least squares
// problems", 2004).
void Minimize(const Pinhole& pinhole, std::span<const PoseObservation> observations,
              std::span<const std::uint8_t> inlier, const HuberLoss& loss, const PoseRefinementOptions& options,
              SE3* pose) {
  const auto linearize = [&]() {
    NormalEquations equations = Linearize(pinhole, *pose, observations, inlier, loss);
    if (options.prior) AddPrior(*options.prior, *pose, &equations);
    return equations;
  };
  double damping = 1e-6;
  NormalEquations equations = linearize();
  for (int iteration = 0; iteration < options.iterations_per_round; ++iteration) {
    bool stepped = false;
    for (int attempt = 0; attempt < 6 && !stepped; ++attempt) {
      Matrix6d damped = equations.hessian;
      damped.diagonal() += damping * equations.hessian.diagonal();
      damped.diagonal().array() += 1e-12 * equations.hessian.diagonal().maxCoeff();
      const Vector6d step = -damped.ldlt().solve(equations.gradient);
      if (!step.allFinite()) return;
      const SE3 trial = SE3::Exp(step) * *pose;
      double cost = Cost(pinhole, trial, observations, inlier, loss);
      if (options.prior) cost += PriorResidual(*options.prior, trial).squaredNorm();
      if (cost > equations.cost) {
        damping = std::max(damping, 1e-4) * 10.0;
        continue;
      }
      const bool converged = equations.cost - cost < 1e-9 * (1.0 + equations.cost);
      *pose = trial;
      damping = std::max(1e-9, damping * 0.1);
      stepped = true;
      if (converged) return;
    }
    if (!stepped) return;
    equations = linearize();
  }
}

absl::Status CheckObservations(std::span<const PoseObservation> observations) {
  for (std::size_t i = 0; i < observations.size(); ++i) {
    const PoseObservation& o = observations[i];
    if (!o.point.allFinite() || !o.pixel.allFinite() || !(o.sigma_px > 0.0) || !std::isfinite(o.sigma_px)) {
      return absl::InvalidArgumentError(
          absl::StrCat("pose refinement: observation ", i, " is not finite or its sigma_px is not positive"));
    }
  }
  return absl::OkStatus();
}

absl::Status TooFew(int have, int need, const char* what) {
  return absl::FailedPreconditionError(
      absl::StrCat("pose refinement: ", have, " ", what, ", at least ", need, " needed"));
}

}  // namespace

absl::Status PoseRefinementOptions::Validate() const {
  if (rounds < 1) return absl::InvalidArgumentError("pose refinement: rounds must be at least 1");
  if (iterations_per_round < 1)
    return absl::InvalidArgumentError("pose refinement: iterations_per_round must be at least 1");
  if (!(chi2_threshold > 0.0)) return absl::InvalidArgumentError("pose refinement: chi2_threshold must be positive");
  if (!(huber_threshold > 0.0)) return absl::InvalidArgumentError("pose refinement: huber_threshold must be positive");
  if (prior && !(prior->translation_sigma > 0.0 && prior->rotation_sigma_rad > 0.0)) {
    return absl::InvalidArgumentError("pose refinement: the sigmas of the prior must be positive");
  }
  if (min_observations < 3) return absl::InvalidArgumentError("pose refinement: min_observations must be at least 3");
  return absl::OkStatus();
}

absl::StatusOr<PoseRefinement> RefinePose(const Pinhole& pinhole, const SE3& initial_camera_from_map,
                                          std::span<const PoseObservation> observations,
                                          const PoseRefinementOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(CheckObservations(observations));
  const int count = static_cast<int>(observations.size());
  if (count < options.min_observations) return TooFew(count, options.min_observations, "observations");

  PoseRefinement result;
  result.camera_from_map = initial_camera_from_map;
  result.inlier.assign(observations.size(), 1);
  const HuberLoss loss{options.huber_threshold};
  for (int round = 0; round < options.rounds; ++round) {
    Minimize(pinhole, observations, result.inlier, loss, options, &result.camera_from_map);
    result.num_inliers = 0;
    result.chi2 = 0.0;
    bool changed = false;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const double chi2 = ChiSquare(pinhole, result.camera_from_map, observations[i]);
      const std::uint8_t inlier = chi2 <= options.chi2_threshold ? 1 : 0;
      changed |= inlier != result.inlier[i];
      result.inlier[i] = inlier;
      result.num_inliers += inlier;
      if (inlier) result.chi2 += chi2;
    }
    if (result.num_inliers < options.min_observations) {
      return TooFew(result.num_inliers, options.min_observations, "observations agree");
    }
    if (!changed) break;
  }

  NormalEquations final = Linearize(pinhole, result.camera_from_map, observations, result.inlier, HuberLoss{1e9});
  if (options.prior) AddPrior(*options.prior, result.camera_from_map, &final);
  // Translation and rotation have different units: judge the conditioning after scaling to a unit diagonal.
  const Vector6d diagonal = final.hessian.diagonal();
  if (!(diagonal.minCoeff() > 0.0)) return absl::FailedPreconditionError("pose refinement: the pose is undetermined");
  const Vector6d scale = diagonal.cwiseSqrt().cwiseInverse();
  const Matrix6d scaled = scale.asDiagonal() * final.hessian * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(scaled);
  if (eigen.info() != Eigen::Success || eigen.eigenvalues()[0] < 1e-10 * eigen.eigenvalues()[5]) {
    return absl::FailedPreconditionError(
        "pose refinement: the matches leave the pose undetermined (degenerate geometry)");
  }
  const double freedom = std::max(1.0, 2.0 * result.num_inliers - 6.0);
  const Matrix6d inverse =
      eigen.eigenvectors() * eigen.eigenvalues().cwiseInverse().asDiagonal() * eigen.eigenvectors().transpose();
  result.covariance = std::max(1.0, result.chi2 / freedom) * (scale.asDiagonal() * inverse * scale.asDiagonal());
  return result;
}

Matrix6d CovarianceOfInverse(const SE3& camera_from_map, const Matrix6d& covariance) {
  // (Exp(x) T)^-1 = T^-1 Exp(-x) = Exp(-Ad(T^-1) x) T^-1.
  const Matrix6d adjoint = camera_from_map.Inverse().Adjoint();
  return adjoint * covariance * adjoint.transpose();
}

}  // namespace cairn::optimization
