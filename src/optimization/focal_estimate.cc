#include "optimization/focal_estimate.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "optimization/normal_sum.h"

namespace cairn::optimization {
namespace {

using Matrix9d = Eigen::Matrix<double, 9, 9>;
using Vector9d = Eigen::Matrix<double, 9, 1>;

constexpr int kLeastInliers = 15;
constexpr double kBehind = 1e6;  // chi-square of a point behind the camera

constexpr double kContradictionSigmas = 5.0, kDoubtSigmas = 3.0;
// What is known better than this is left to the doubts: a calibration that is off by more than a few per cent would be
// seen. What is not may be off by up to the second: five times as much is the worst that is found in the field. With
// half the right focal length a wall that is seen straight is twice as far away as the pose says.
constexpr double kToldFocal = 0.015, kWorstFocal = 0.21;
constexpr double kToldPrincipal = 0.01, kWorstPrincipal = 0.04;

double LongerSide(const Pinhole& pinhole) { return std::max(pinhole.width_px, pinhole.height_px); }

struct FocalState {
  SE3 camera_from_map;
  double log_scale = 0.0;
  Vector2d shift = Vector2d::Zero();  // share of the longer side

  Pinhole Applied(const Pinhole& pinhole) const {
    Pinhole applied = pinhole;
    applied.fx_px *= std::exp(log_scale);
    applied.fy_px *= std::exp(log_scale);
    applied.cx_px += LongerSide(pinhole) * shift.x();
    applied.cy_px += LongerSide(pinhole) * shift.y();
    return applied;
  }
};

struct FocalEquations {
  Matrix9d hessian = Matrix9d::Zero();
  Vector9d gradient = Vector9d::Zero();
  double cost = 0.0;
};

double ChiSquareOf(const Pinhole& pinhole, const SE3& camera_from_map, const PoseObservation& observation) {
  const Vector3d point_c = camera_from_map * observation.point;
  if (!InFront(point_c)) return kBehind;
  const Vector2d residual = ReprojectionResidual(pinhole, point_c, observation.pixel);
  return std::min(kBehind, residual.squaredNorm() / (observation.sigma_px * observation.sigma_px));
}

void AddPrior(const FocalState& state, const FocalPrior& prior, FocalEquations* sum) {
  const Vector3d value(state.log_scale, state.shift.x(), state.shift.y());
  const Vector3d sigma(prior.log_focal_sigma, prior.principal_sigma, prior.principal_sigma);
  const Vector3d precision = sigma.cwiseProduct(sigma).cwiseInverse();
  sum->hessian.diagonal().tail<3>() += precision;
  sum->gradient.tail<3>() += precision.cwiseProduct(value);
  sum->cost += value.cwiseProduct(value).dot(precision);
}

FocalEquations LinearizeAt(const Pinhole& pinhole, const FocalState& state,
                           std::span<const PoseObservation> observations, std::span<const std::uint8_t> inlier,
                           const HuberLoss& loss, const FocalPrior& prior) {
  FocalEquations sum;
  const Pinhole applied = state.Applied(pinhole);
  const Matrix3d rotation = state.camera_from_map.RotationMatrix();
  NormalSum pose_and_focal;
  // The residual goes with the shift of the principal point one to one, by the longer side.
  NormalSum::Row by_shift_x = NormalSum::Row::Zero(), by_shift_y = NormalSum::Row::Zero();
  double shift_weight = 0.0;
  for (std::size_t i = 0; i < observations.size(); ++i) {
    if (!inlier[i]) continue;
    const PoseObservation& observation = observations[i];
    const Vector3d point_c = rotation * observation.point + state.camera_from_map.translation();
    if (!InFront(point_c)) {
      sum.cost += loss.Value(kBehind);
      continue;
    }
    const double precision = 1.0 / (observation.sigma_px * observation.sigma_px);
    const Vector2d residual = ReprojectionResidual(applied, point_c, observation.pixel);
    const double chi2 = std::min(kBehind, residual.squaredNorm() * precision);
    sum.cost += loss.Value(chi2);
    if (chi2 >= kBehind) continue;
    Eigen::Matrix<double, 2, 7> j;
    j.leftCols<6>() = ReprojectionByPose(applied, point_c);
    j.col(6) = ReprojectionByLogFocal(applied, point_c);
    const NormalSum::Row u = NormalSum::RowOf<7>(j.row(0), residual.x());
    const NormalSum::Row v = NormalSum::RowOf<7>(j.row(1), residual.y());
    const double weight = loss.Weight(chi2) * precision;
    pose_and_focal.Add(weight, u, v);
    by_shift_x += weight * u;
    by_shift_y += weight * v;
    shift_weight += weight;
  }
  const double side = LongerSide(pinhole);
  sum.hessian.topLeftCorner<7, 7>() = pose_and_focal.Hessian<7>();
  sum.hessian.block<7, 1>(0, 7) = side * by_shift_x.head<7>();
  sum.hessian.block<7, 1>(0, 8) = side * by_shift_y.head<7>();
  sum.hessian.bottomLeftCorner<2, 7>() = sum.hessian.topRightCorner<7, 2>().transpose();
  sum.hessian(7, 7) = sum.hessian(8, 8) = side * side * shift_weight;
  sum.gradient << pose_and_focal.Gradient<7>(), side * by_shift_x[7], side * by_shift_y[7];
  AddPrior(state, prior, &sum);
  return sum;
}

void MinimizeWithFocal(const Pinhole& pinhole, std::span<const PoseObservation> observations,
                       std::span<const std::uint8_t> inlier, const HuberLoss& loss, int iterations,
                       const FocalPrior& prior, FocalState* state) {
  double damping = 1e-4;
  FocalEquations equations = LinearizeAt(pinhole, *state, observations, inlier, loss, prior);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    Matrix9d damped = equations.hessian;
    damped.diagonal() *= 1.0 + damping;
    const Vector9d step = -damped.ldlt().solve(equations.gradient);
    if (!step.allFinite()) return;
    FocalState trial = *state;
    trial.camera_from_map = SE3::Exp(step.head<6>()) * trial.camera_from_map;
    trial.log_scale += std::clamp(step[6], -0.3, 0.3);
    trial.shift += step.tail<2>().cwiseMax(-0.1).cwiseMin(0.1);
    const FocalEquations there = LinearizeAt(pinhole, trial, observations, inlier, loss, prior);
    if (there.cost > equations.cost) {
      damping *= 10.0;
      if (damping > 1e8) return;
      continue;
    }
    const bool converged = equations.cost - there.cost < 1e-6 * (1.0 + equations.cost);
    *state = trial;
    equations = there;
    damping = std::max(1e-9, 0.1 * damping);
    if (converged) return;
  }
}

bool Exceeds(double value, double sigma, double usual, double sigmas) {
  return std::abs(value) > sigmas * std::hypot(sigma, usual);
}

// Of a standard deviation, what is beyond what is told in other ways, up to the worst.
double Open(double sigma, double told, double worst) {
  const double capped = std::min(sigma, worst);
  return std::sqrt(std::max(0.0, capped * capped - told * told));
}

// Standard deviations and how the pose goes with the calibration. False: it is undetermined.
bool Spread(const Matrix9d& hessian, double variance_factor, FocalEstimate* estimate) {
  const Vector9d diagonal = hessian.diagonal();
  if (!(diagonal.minCoeff() > 0.0)) return false;
  const Vector9d scale = diagonal.cwiseSqrt().cwiseInverse();
  const Matrix9d scaled = scale.asDiagonal() * hessian * scale.asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Matrix6d> pose(scaled.topLeftCorner<6, 6>());
  if (pose.info() != Eigen::Success || pose.eigenvalues()[0] < 1e-10 * pose.eigenvalues()[5]) return false;
  const Eigen::LDLT<Matrix9d> ldlt(scaled);
  const Matrix9d inverse = ldlt.solve(Matrix9d::Identity());
  if (!inverse.allFinite() || !(inverse.diagonal().minCoeff() > 0.0)) return false;
  const Vector9d sigma = std::sqrt(variance_factor) * inverse.diagonal().cwiseSqrt().cwiseProduct(scale);
  estimate->log_sigma = sigma[6];
  estimate->principal_sigma = sigma.tail<2>();
  estimate->by_calibration =
      -hessian.topLeftCorner<6, 6>().ldlt().solve(Eigen::Matrix<double, 6, 3>(hessian.topRightCorner<6, 3>()));
  return estimate->by_calibration.allFinite();
}

}  // namespace

Pinhole FocalEstimate::Corrected(const Pinhole& pinhole) const {
  return FocalState{camera_from_map, std::log(scale), principal_shift}.Applied(pinhole);
}

bool FocalEstimate::FocalContradicts() const {
  return Exceeds(std::log(scale), log_sigma, kUsualFocalError, kContradictionSigmas);
}

bool FocalEstimate::PrincipalContradicts() const {
  return Exceeds(principal_shift.x(), principal_sigma.x(), kUsualPrincipalError, kContradictionSigmas) ||
         Exceeds(principal_shift.y(), principal_sigma.y(), kUsualPrincipalError, kContradictionSigmas);
}

bool FocalEstimate::Doubts() const {
  const auto doubts = [](double value, double sigma, double usual) {
    return std::abs(value) >= std::max(usual, kDoubtSigmas * sigma);
  };
  return doubts(std::log(scale), log_sigma, kUsualFocalError) ||
         doubts(principal_shift.x(), principal_sigma.x(), kUsualPrincipalError) ||
         doubts(principal_shift.y(), principal_sigma.y(), kUsualPrincipalError);
}

absl::StatusOr<FocalEstimate> EstimateFocal(const Pinhole& pinhole, const SE3& camera_from_map,
                                            std::span<const PoseObservation> observations,
                                            const PoseRefinementOptions& options, const FocalPrior& prior) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  for (const PoseObservation& o : observations) {
    if (!o.point.allFinite() || !o.pixel.allFinite() || !(o.sigma_px > 0.0) || !std::isfinite(o.sigma_px)) {
      return absl::InvalidArgumentError("focal length: an observation is not finite or has no positive sigma_px");
    }
  }
  const HuberLoss loss{options.huber_threshold};
  FocalState state{camera_from_map};
  std::vector<std::uint8_t> inlier(observations.size(), 1);
  FocalEstimate estimate;
  double chi2 = 0.0;
  for (int round = 0; round < options.rounds; ++round) {
    MinimizeWithFocal(pinhole, observations, inlier, loss, 2 * options.iterations_per_round, prior, &state);
    const Pinhole applied = state.Applied(pinhole);
    estimate.num_inliers = 0;
    chi2 = 0.0;
    for (std::size_t i = 0; i < observations.size(); ++i) {
      const double own = ChiSquareOf(applied, state.camera_from_map, observations[i]);
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
  const double factor = std::max(1.0, chi2 / std::max(1.0, 2.0 * estimate.num_inliers - 9.0));
  const FocalEquations final = LinearizeAt(pinhole, state, observations, inlier, HuberLoss{1e9}, prior);
  if (!Spread(final.hessian, factor, &estimate)) {
    return absl::FailedPreconditionError("focal length: the pose is undetermined");
  }
  estimate.scale = std::exp(state.log_scale);
  estimate.principal_shift = state.shift;
  estimate.camera_from_map = state.camera_from_map;
  return estimate;
}

Matrix6d CoverFocal(const SE3& camera_from_map, const Matrix6d& covariance, const FocalEstimate& estimate) {
  Matrix6d covered = covariance;
  const bool doubts = estimate.Doubts();
  if (doubts || estimate.log_sigma > kToldFocal) {
    const Vector6d apart = (estimate.camera_from_map * camera_from_map.Inverse()).Log();
    covered += apart * apart.transpose();
  }
  // The pose with the calibration that is found is as open as that.
  const double told_focal = doubts ? 0.0 : kToldFocal, told_principal = doubts ? 0.0 : kToldPrincipal;
  const Vector3d open(Open(estimate.log_sigma, told_focal, kWorstFocal),
                      Open(estimate.principal_sigma.x(), told_principal, kWorstPrincipal),
                      Open(estimate.principal_sigma.y(), told_principal, kWorstPrincipal));
  const Eigen::Matrix<double, 6, 3> by_open = estimate.by_calibration * open.asDiagonal();
  return covered + by_open * by_open.transpose();
}

}  // namespace cairn::optimization
