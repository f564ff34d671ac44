#include "geometry/pose_alignment.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "base/median.h"
#include "geometry/pose_alignment_model.h"
#include "geometry/pose_alignment_start.h"

namespace cairn {
namespace {

using State = PoseAlignmentState;
using Information = Eigen::Matrix<double, State::kSize, State::kSize>;

constexpr double kFreedom = 4.0;              // of Student's t
constexpr double kMedianOfNormal3d = 1.5382;  // of the length of a vector of three standard normal numbers
constexpr double kFitsWithin = 5.0;           // sigma
// What cannot be told from a good pair: a percent of the positions' spread, half a degree.
constexpr double kFitFloorShare = 0.01;
constexpr double kFitFloor_rad = 0.0087;
// Numbers in files are rounded, and covariances must not be 0. With less, what is known only beforehand, as the roll of
// a straight drive, would be lost in the rounding of the normal equations beside what the positions show.
constexpr double kNoiseFloorShare = 1e-6;
constexpr double kNoiseFloor_rad = 1e-6;

// The residuals of one kind, and what they say about its noise.
struct Kind {
  std::vector<Vector3d> residuals;
  std::vector<PoseAlignmentJacobian> jacobians;
  double sigma_given = 0.0;
  double sigma_floor = 0.0;
  double fit_floor = 0.0;
  double parameters = 0.0;  // that these residuals determine, of the fitted ones
  double sigma = 0.0;       // robust, per axis
  std::vector<double> weights;
  // Per axis, of one observation of a least-squares fit that is as certain as this one.
  double effective_variance = 0.0;
  double slope = 1.0;  // mean derivative of the weighted residual by the residual

  // Few residuals know their median badly (the factor is the one of Rousseeuw, Leroy, "Robust regression", 1987).
  bool Fits(std::size_t i) const {
    const double few = 1.0 + 5.0 / std::max(1.0, static_cast<double>(residuals.size()) - 3.0);
    return residuals[i].norm() <= kFitsWithin * std::max(few * sigma, fit_floor);
  }

  double Redundancy(double count) const { return std::max(1.0, 3.0 * count - parameters); }

  void UpdateSigma() {
    std::vector<double> lengths;
    for (const Vector3d& residual : residuals) lengths.push_back(residual.norm());
    const double n = static_cast<double>(lengths.size());
    sigma = sigma_given > 0.0 ? sigma_given
                              : Median(std::move(lengths)) / kMedianOfNormal3d * std::sqrt(3.0 * n / Redundancy(n));
    sigma = std::max(sigma, sigma_floor);
  }

  void UpdateWeights(const std::vector<bool>& fits) {
    weights.assign(residuals.size(), 0.0);
    double slope_sum = 0.0, square_sum = 0.0, count = 0.0;
    std::vector<Vector3d> influence;
    for (std::size_t i = 0; i < residuals.size(); ++i) {
      if (!fits[i]) continue;
      const double u = residuals[i].squaredNorm() / (sigma * sigma);
      const double w = (kFreedom + 3.0) / (kFreedom + u);
      weights[i] = w;
      slope_sum += w - 2.0 / 3.0 * w * w * u / (kFreedom + 3.0);
      square_sum += w * w * residuals[i].squaredNorm() / 3.0;
      count += 1.0;
      influence.push_back(w * residuals[i]);
    }
    if (count == 0.0) return;
    constexpr double kMinSlope = 0.1;
    slope = std::max(kMinSlope, slope_sum / count);
    effective_variance = sigma_given > 0.0 ? sigma_given * sigma_given
                                           : square_sum / count / (slope * slope) * 3.0 * count / Redundancy(count);
    effective_variance = std::max(effective_variance, sigma_floor * sigma_floor) * SerialCorrelation(influence);
  }

  // How many times larger the variance of the sum is than that of as many independent residuals: 1 + 2 sum rho_k, up to
  // the first lag whose correlation chance explains. Of a long series that of the sums of its blocks.
  static double SerialCorrelation(const std::vector<Vector3d>& series) {
    constexpr std::size_t kMostBlocks = 500;
    const std::size_t length = (series.size() + kMostBlocks - 1) / kMostBlocks;
    double square_sum = 0.0, block_square_sum = 0.0;
    std::vector<Vector3d> blocks;
    for (std::size_t i = 0; i < series.size(); ++i) {
      square_sum += series[i].squaredNorm();
      if (i % length == 0) blocks.emplace_back(Vector3d::Zero());
      blocks.back() += series[i];
    }
    if (!(square_sum > 0.0)) return 1.0;
    for (const Vector3d& block : blocks) block_square_sum += block.squaredNorm();
    const std::size_t n = blocks.size();
    const double chance = 2.0 / std::sqrt(3.0 * static_cast<double>(n));
    double factor = 1.0;
    for (std::size_t lag = 1; lag < n / 3; ++lag) {
      double sum = 0.0;
      for (std::size_t i = 0; i + lag < n; ++i) sum += blocks[i].dot(blocks[i + lag]);
      const double rho = sum / block_square_sum;
      if (rho < chance) break;
      factor += 2.0 * rho;
    }
    const double most = std::max(1.0, static_cast<double>(series.size()) / 3.0);
    return std::clamp(factor * block_square_sum / square_sum, 1.0, most);
  }
};

struct Fit {
  State state;
  Kind position, rotation;
  std::vector<bool> fits;
  Information covariance = Information::Zero();
  double cost = 0.0;  // negative log likelihood up to a constant
};

class Solver {
 public:
  Solver(std::span<const SE3> a, std::span<const SE3> b, const PoseAlignmentOptions& options, double spread)
      : a_(a), b_(b), options_(options), spread_(spread) {}

  Fit Solve(const State& start, bool use_rotation, bool use_mount) const {
    Fit fit;
    fit.state = start;
    fit.position.sigma_given = options_.sigma_position;
    fit.position.sigma_floor = kNoiseFloorShare * spread_;
    fit.position.fit_floor = kFitFloorShare * spread_;
    fit.position.parameters = use_rotation && !use_mount ? 4.0 : 7.0;
    fit.rotation.sigma_given = options_.sigma_rotation_rad;
    fit.rotation.sigma_floor = kNoiseFloor_rad;
    fit.rotation.fit_floor = kFitFloor_rad;
    fit.rotation.parameters = use_mount ? 6.0 : 3.0;
    constexpr int kIterations = 50;
    constexpr double kSmallStep = 1e-10;  // squared, in standard deviations
    for (int k = 0; k < kIterations; ++k) {
      Linearize(fit, use_rotation, use_mount);
      const State::Increment step = Step(fit, use_rotation);
      const double size = step.dot(step.cwiseQuotient(fit.covariance.diagonal()));
      if (size < kSmallStep) break;
      fit.state = fit.state.Plus(step);
    }
    Linearize(fit, use_rotation, use_mount);
    Step(fit, use_rotation);
    fit.cost = Cost(fit.position) + (use_rotation ? Cost(fit.rotation) : 0.0);
    return fit;
  }

 private:
  void Linearize(Fit& fit, bool use_rotation, bool use_mount) const {
    Kind& position = fit.position;
    Kind& rotation = fit.rotation;
    for (Kind* kind : {&position, &rotation}) {
      kind->residuals.clear();
      kind->jacobians.clear();
    }
    for (std::size_t i = 0; i < a_.size(); ++i) {
      PoseAlignmentResidual residual = LinearizePoseAlignment(fit.state, a_[i], b_[i]);
      if (!options_.with_scale) residual.position_jacobian.col(State::kLogScale).setZero();
      if (!use_mount) {
        residual.rotation_jacobian.middleCols<3>(State::kMount).setZero();
        residual.position_jacobian.middleCols<3>(State::kLever).setZero();
      }
      position.residuals.push_back(residual.position);
      position.jacobians.push_back(residual.position_jacobian);
      rotation.residuals.push_back(residual.rotation_rad);
      rotation.jacobians.push_back(residual.rotation_jacobian);
    }
    position.UpdateSigma();
    rotation.UpdateSigma();
    fit.fits.assign(a_.size(), false);
    for (std::size_t i = 0; i < a_.size(); ++i) fit.fits[i] = position.Fits(i) && (!use_rotation || rotation.Fits(i));
    position.UpdateWeights(fit.fits);
    if (use_rotation) rotation.UpdateWeights(fit.fits);
  }

  // Weighted normal equations; brings the covariance and the shares of the parameters up to date.
  State::Increment Step(Fit& fit, bool use_rotation) const {
    // What nothing determines is known this well beforehand.
    constexpr double kPriorTurn_rad = std::numbers::pi, kPriorLogScale = 3.0;
    Information prior = Information::Zero();
    prior.diagonal().segment<3>(State::kRotation).setConstant(1.0 / (kPriorTurn_rad * kPriorTurn_rad));
    prior.diagonal()[State::kLogScale] = 1.0 / (kPriorLogScale * kPriorLogScale);
    prior.diagonal().segment<3>(State::kMount).setConstant(1.0 / (kPriorTurn_rad * kPriorTurn_rad));
    // The camera is on the body, not far from it.
    prior.diagonal().segment<3>(State::kLever).setConstant(1.0 / (spread_ * spread_));
    Information normal = prior, total = prior;
    std::array<Information, 2> of_kind{Information::Zero(), Information::Zero()};
    State::Increment gradient = State::Increment::Zero();
    gradient.segment<3>(State::kLever) = fit.state.camera_in_body / (spread_ * spread_);
    const std::array<const Kind*, 2> kinds{&fit.position, &fit.rotation};
    for (std::size_t k = 0; k < (use_rotation ? 2u : 1u); ++k) {
      const Kind& kind = *kinds[k];
      if (!(kind.effective_variance > 0.0)) continue;
      const double factor = 1.0 / (kind.slope * kind.effective_variance);
      for (std::size_t i = 0; i < kind.residuals.size(); ++i) {
        if (!fit.fits[i]) continue;
        const PoseAlignmentJacobian& jacobian = kind.jacobians[i];
        const Information square = jacobian.transpose() * jacobian;
        normal += factor * kind.weights[i] * square;
        of_kind[k] += square / kind.effective_variance;
        gradient += factor * kind.weights[i] * (jacobian.transpose() * kind.residuals[i]);
      }
      total += of_kind[k];
    }
    fit.covariance = Inverse(total);
    fit.position.parameters = (of_kind[0] * fit.covariance).trace();
    if (use_rotation) fit.rotation.parameters = (of_kind[1] * fit.covariance).trace();
    State::Increment step = -(Inverse(normal) * gradient);
    constexpr double kMaxTurn_rad = 0.5, kMaxLogScale = 1.0;
    const double turn = std::max(step.segment<3>(State::kRotation).norm(), step.segment<3>(State::kMount).norm());
    const double excess = std::max(turn / kMaxTurn_rad, std::abs(step[State::kLogScale]) / kMaxLogScale);
    if (excess > 1.0) step /= excess;
    return step;
  }

  // Rows of different units are brought to the same size first. What rounding leaves open counts as unknown, never as
  // known: an eigenvalue that should be tiny may come out negative.
  static Information Inverse(const Information& information) {
    const State::Increment unit = information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const Information scaled = unit.asDiagonal() * information * unit.asDiagonal();
    const Eigen::SelfAdjointEigenSolver<Information> eigen(scaled);
    const State::Increment values =
        eigen.eigenvalues().cwiseMax(std::numeric_limits<double>::epsilon() * eigen.eigenvalues().maxCoeff());
    const Information inverse =
        eigen.eigenvectors() * values.cwiseInverse().asDiagonal() * eigen.eigenvectors().transpose();
    return unit.asDiagonal() * inverse * unit.asDiagonal();
  }

  static double Cost(const Kind& kind) {
    double cost = 3.0 * static_cast<double>(kind.residuals.size()) * std::log(kind.sigma);
    for (const Vector3d& residual : kind.residuals) {
      cost += 0.5 * (kFreedom + 3.0) * std::log1p(residual.squaredNorm() / (kFreedom * kind.sigma * kind.sigma));
    }
    return cost;
  }

  std::span<const SE3> a_, b_;
  const PoseAlignmentOptions& options_;
  double spread_;
};

// Median distance from the middle of the coordinates: outliers do not count.
double MedianSpread(std::span<const SE3> poses) {
  Vector3d middle;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const SE3& pose : poses) values.push_back(pose.translation()[axis]);
    middle[axis] = Median(std::move(values));
  }
  std::vector<double> distances;
  for (const SE3& pose : poses) distances.push_back((pose.translation() - middle).norm());
  return Median(std::move(distances));
}

double MedianError(const Kind& kind) {
  std::vector<double> lengths;
  for (const Vector3d& residual : kind.residuals) lengths.push_back(residual.norm());
  return Median(std::move(lengths));
}

// Does the rotation of the orientations take the positions of b to those of a, but for 0.1 rad or the noise? Where
// positions are much the surer of the two the joint fit follows them, and it is the orientations that all stand apart:
// by more than `noise_rad`, what they differ by from one time to another.
bool PositionsAgree(const Fit& joint, const Fit& positions, double spread, double noise_rad) {
  constexpr double kMaxTurn_rad = 0.1;
  if (MedianError(joint.rotation) > std::max(kMaxTurn_rad, 2.0 * noise_rad)) return false;
  const double with = MedianError(joint.position), without = MedianError(positions.position);
  const double allowed = kMaxTurn_rad * spread;
  return with <= 2.0 * without || with * with - without * without <= allowed * allowed;
}

double WorstSigma(const Matrix3d& covariance) {
  return std::sqrt(std::max(0.0, Eigen::SelfAdjointEigenSolver<Matrix3d>(covariance).eigenvalues()[2]));
}

absl::Status CheckPoses(std::span<const SE3> a, std::span<const SE3> b) {
  if (a.size() != b.size()) {
    return absl::InvalidArgumentError(
        absl::StrCat("alignment needs as many poses in a (", a.size(), ") as in b (", b.size(), ")"));
  }
  for (std::size_t i = 0; i < a.size(); ++i) {
    if (!a[i].translation().allFinite() || !b[i].translation().allFinite() || !a[i].rotation().coeffs().allFinite() ||
        !b[i].rotation().coeffs().allFinite()) {
      return absl::InvalidArgumentError(absl::StrCat("alignment: pair ", i, " holds a number that is not finite"));
    }
  }
  if (a.size() < 3) {
    return absl::FailedPreconditionError(absl::StrCat("alignment needs at least 3 pairs of poses, got ", a.size()));
  }
  return absl::OkStatus();
}

bool Coincide(std::span<const SE3> poses) {
  double size = 1e-12, spread = 0.0;
  for (const SE3& pose : poses) {
    size = std::max(size, pose.translation().norm());
    spread = std::max(spread, (pose.translation() - poses[0].translation()).norm());
  }
  return spread <= 1e-12 * size;
}

PoseAlignment Summarize(const Fit& fit, const OrientationAgreement& orientations, bool use_rotation, bool with_scale) {
  PoseAlignment result;
  result.a_from_b = fit.state.AFromB();
  result.center_b = fit.state.center_b;
  result.orientations = orientations;
  if (use_rotation) result.orientations.camera_from_body = fit.state.camera_from_body;
  result.orientations_used = use_rotation;
  result.covariance = fit.covariance.topLeftCorner<7, 7>();
  if (!with_scale) {
    result.covariance.row(State::kLogScale).setZero();
    result.covariance.col(State::kLogScale).setZero();
  }
  result.scale_sigma = fit.state.scale * std::sqrt(result.covariance(State::kLogScale, State::kLogScale));
  result.center_sigma = WorstSigma(result.covariance.topLeftCorner<3, 3>());
  result.rotation_sigma_rad =
      std::min(std::numbers::pi, WorstSigma(result.covariance.block<3, 3>(State::kRotation, State::kRotation)));
  if (use_rotation && orientations.kind == OrientationKind::kBody) {
    result.mount_sigma_rad =
        std::min(std::numbers::pi, WorstSigma(fit.covariance.block<3, 3>(State::kMount, State::kMount)));
    result.camera_in_body = fit.state.camera_in_body;
    result.camera_in_body_sigma = WorstSigma(fit.covariance.block<3, 3>(State::kLever, State::kLever));
  }
  result.fits = fit.fits;
  result.fit_count = static_cast<int>(std::count(fit.fits.begin(), fit.fits.end(), true));
  double all = 0.0, fitting = 0.0, fitting_rotation = 0.0;
  for (std::size_t i = 0; i < fit.fits.size(); ++i) {
    const double square = fit.position.residuals[i].squaredNorm();
    result.position_error.push_back(std::sqrt(square));
    result.rotation_error_rad.push_back(fit.rotation.residuals[i].norm());
    all += square;
    if (!fit.fits[i]) continue;
    fitting += square;
    fitting_rotation += fit.rotation.residuals[i].squaredNorm();
  }
  const double count = std::max(1, result.fit_count);
  result.rmse_all = std::sqrt(all / static_cast<double>(fit.fits.size()));
  result.rmse_fits = std::sqrt(fitting / count);
  result.sigma_position = std::sqrt(fitting / fit.position.Redundancy(count));
  if (use_rotation) result.sigma_rotation_rad = std::sqrt(fitting_rotation / fit.rotation.Redundancy(count));
  return result;
}

double Spread(std::span<const SE3> poses, const std::vector<bool>& take_part) {
  Vector3d mean = Vector3d::Zero();
  double count = 0.0, sum = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!take_part[i]) continue;
    mean += poses[i].translation();
    count += 1.0;
  }
  if (count == 0.0) return 0.0;
  mean /= count;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (take_part[i]) sum += (poses[i].translation() - mean).squaredNorm();
  }
  return std::sqrt(sum / count);
}

}  // namespace

absl::Status PoseAlignmentOptions::Validate() const {
  for (const double sigma : {sigma_position, sigma_rotation_rad}) {
    if (!(sigma >= 0.0) || !std::isfinite(sigma)) {
      return absl::InvalidArgumentError(absl::StrCat("a standard deviation must not be negative, is ", sigma));
    }
  }
  if (max_samples < 1) return absl::InvalidArgumentError("max_samples must be at least 1");
  return absl::OkStatus();
}

absl::StatusOr<PoseAlignment> AlignPoses(std::span<const SE3> poses_a, std::span<const SE3> poses_b,
                                         const PoseAlignmentOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(CheckPoses(poses_a, poses_b));
  if (Coincide(poses_a) || Coincide(poses_b)) {
    return absl::FailedPreconditionError(
        absl::StrCat("alignment: all positions of the ", Coincide(poses_a) ? "reference" : "map",
                     " coincide; orientations alone do not determine the scale. A recording whose camera moves helps"));
  }
  OrientationAgreement orientations;
  if (options.use_orientations) orientations = CompareOrientations(poses_a, poses_b, options.agreement);
  const bool with_mount = orientations.kind == OrientationKind::kBody;
  const bool use_rotation = with_mount || orientations.kind == OrientationKind::kCamera;
  const double spread = std::max(MedianSpread(poses_a), 1e-12);
  const Solver solver(poses_a, poses_b, options, spread);
  const PoseAlignmentStartOptions start{options.with_scale, options.max_samples, options.seed};

  const absl::StatusOr<State> from_positions = StartFromPositions(poses_a, poses_b, with_mount, start);
  std::optional<Fit> positions;
  if (from_positions.ok()) positions = solver.Solve(*from_positions, false, false);
  if (use_rotation) {
    Fit joint =
        solver.Solve(StartFromOrientations(poses_a, poses_b, orientations.camera_from_body, start), true, with_mount);
    if (from_positions.ok()) {
      Fit other = solver.Solve(*from_positions, true, with_mount);
      if (other.cost < joint.cost) joint = std::move(other);
    }
    PoseAlignment result;
    if (!positions || PositionsAgree(joint, *positions, spread, orientations.mounted_difference_rad)) {
      result = Summarize(joint, orientations, true, options.with_scale);
      result.spread = Spread(poses_a, result.fits);
      return result;
    }
    orientations.kind = OrientationKind::kOtherFrame;
  }
  if (!positions) return from_positions.status();
  PoseAlignment result = Summarize(*positions, orientations, false, options.with_scale);
  result.spread = Spread(poses_a, result.fits);
  return result;
}

}  // namespace cairn
