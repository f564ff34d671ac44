#include "optimization/sim3_refinement.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/random.h"
#include "geometry/alignment.h"
#include "optimization/reprojection.h"

namespace cairn::optimization {
namespace {

absl::Status InvalidSim3(const std::string& what) { return absl::InvalidArgumentError("sim3: " + what); }

absl::Status Check(std::span<const Sim3Match> matches) {
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const Sim3Match& m = matches[i];
    const bool a = !m.has_point_a || m.point_a.allFinite();
    const bool b = !m.has_pixel_b || (m.pixel_b.allFinite() && m.sigma_b_px > 0.0 && std::isfinite(m.sigma_b_px));
    if (!a || !b || !m.point_b.allFinite() || !m.pixel_a.allFinite() || !(m.sigma_a_px > 0.0) ||
        !std::isfinite(m.sigma_a_px)) {
      return InvalidSim3(absl::StrCat("match ", i, " is not finite or a sigma is not positive"));
    }
  }
  return absl::OkStatus();
}

double ChiSquare(const Pinhole& pinhole, const Vector3d& point_c, const Vector2d& pixel, double sigma_px) {
  if (!InFront(point_c)) return std::numeric_limits<double>::infinity();
  return ReprojectionResidual(pinhole, point_c, pixel).squaredNorm() / (sigma_px * sigma_px);
}

double LogDistance(const Sim3& a_from_b, const Sim3Match& match) {
  return std::log((a_from_b * match.point_b).norm() / match.point_a.norm());
}

struct Sim3Equations {
  Matrix7d hessian = Matrix7d::Zero();
  Vector7d gradient = Vector7d::Zero();
  double cost = 0.0;
};

class Refiner {
 public:
  Refiner(const Pinhole& pinhole_a, const Pinhole& pinhole_b, std::span<const Sim3Match> matches,
          const Sim3RefinementOptions& options)
      : pinhole_a_(pinhole_a), pinhole_b_(pinhole_b), matches_(matches), options_(options) {}

  absl::StatusOr<Sim3Estimate> Run(const Sim3& initial) {
    Sim3Estimate estimate{initial, std::vector<std::uint8_t>(matches_.size(), 1), 0};
    Classify(100.0 * options_.chi2_threshold, &estimate);  // only what is behind a camera or far off
    for (int round = 0; round < options_.rounds; ++round) {
      CAIRN_RETURN_IF_ERROR(MeasureDistanceSpread(estimate));
      Minimize(&estimate);
      const std::vector<std::uint8_t> before = estimate.inlier;
      Classify(options_.chi2_threshold, &estimate);
      if (estimate.num_inliers < options_.min_inliers) return TooFew(estimate.num_inliers);
      if (round > 0 && before == estimate.inlier) break;
    }
    return estimate;
  }

 private:
  absl::Status TooFew(int inliers) const {
    return absl::FailedPreconditionError(
        absl::StrCat("sim3: ", inliers, " matches agree, at least ", options_.min_inliers, " needed"));
  }

  void Classify(double threshold, Sim3Estimate* estimate) const {
    estimate->num_inliers = 0;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      const bool inlier = ChiSquaresOf(pinhole_a_, pinhole_b_, estimate->a_from_b, matches_[i]).Within(threshold);
      estimate->inlier[i] = inlier ? 1 : 0;
      estimate->num_inliers += inlier ? 1 : 0;
    }
  }

  // How well the maps know the points' distances: from the median absolute deviation of the inliers.
  absl::Status MeasureDistanceSpread(const Sim3Estimate& estimate) {
    std::vector<double> values;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (estimate.inlier[i] && matches_[i].has_point_a) values.push_back(LogDistance(estimate.a_from_b, matches_[i]));
    }
    if (values.empty()) return TooFew(0);
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    const double median = *middle;
    for (double& value : values) value = std::abs(value - median);
    std::nth_element(values.begin(), middle, values.end());
    distance_weight_ = 1.0 / std::max(options_.min_distance_sigma, 1.4826 * *middle);
    return absl::OkStatus();
  }

  double Cost(const Sim3& a_from_b, std::span<const std::uint8_t> inlier) const {
    const HuberLoss loss{options_.huber_threshold};
    double cost = 0.0;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!inlier[i]) continue;
      const Sim3ChiSquares chi2 = ChiSquaresOf(pinhole_a_, pinhole_b_, a_from_b, matches_[i]);
      cost += loss.Value(chi2.in_a) + loss.Value(chi2.in_b);
      if (!matches_[i].has_point_a) continue;
      const double distance = distance_weight_ * LogDistance(a_from_b, matches_[i]);
      cost += loss.Value(distance * distance);
    }
    return cost;
  }

  template <int kRows>
  static void Add(const Eigen::Matrix<double, kRows, 7>& j, const Eigen::Matrix<double, kRows, 1>& r,
                  const HuberLoss& loss, Sim3Equations* equations) {
    const double weight = loss.Weight(r.squaredNorm());
    equations->hessian += weight * j.transpose() * j;
    equations->gradient += weight * j.transpose() * r;
    equations->cost += loss.Value(r.squaredNorm());
  }

  Sim3Equations Linearize(const Sim3& a_from_b, std::span<const std::uint8_t> inlier) const {
    const HuberLoss loss{options_.huber_threshold};
    const Sim3 b_from_a = a_from_b.Inverse();
    Sim3Equations equations;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (!inlier[i]) continue;
      const Sim3Match& m = matches_[i];
      const Vector3d in_a = a_from_b * m.point_b;
      Add<2>(ForwardReprojectionBySim3(pinhole_a_, in_a) / m.sigma_a_px,
             ReprojectionResidual(pinhole_a_, in_a, m.pixel_a) / m.sigma_a_px, loss, &equations);
      if (!m.has_point_a) continue;
      Add<1>(distance_weight_ * LogDistanceBySim3(in_a),
             Eigen::Matrix<double, 1, 1>(distance_weight_ * LogDistance(a_from_b, m)), loss, &equations);
      if (!m.has_pixel_b) continue;
      Add<2>(BackwardReprojectionBySim3(pinhole_b_, a_from_b, m.point_a) / m.sigma_b_px,
             ReprojectionResidual(pinhole_b_, b_from_a * m.point_a, m.pixel_b) / m.sigma_b_px, loss, &equations);
    }
    return equations;
  }

  // As in optimization/pose_refinement.cc.
  void Minimize(Sim3Estimate* estimate) const {
    double damping = 1e-6;
    for (int iteration = 0; iteration < options_.iterations_per_round; ++iteration) {
      const Sim3Equations equations = Linearize(estimate->a_from_b, estimate->inlier);
      bool stepped = false, converged = false;
      for (int attempt = 0; attempt < 6 && !stepped; ++attempt) {
        Matrix7d damped = equations.hessian;
        damped.diagonal() += damping * equations.hessian.diagonal();
        damped.diagonal().array() += 1e-12 * equations.hessian.diagonal().maxCoeff();
        const Vector7d step = -damped.ldlt().solve(equations.gradient);
        if (!step.allFinite()) return;
        const Sim3 trial = Sim3::Exp(step) * estimate->a_from_b;
        const double cost = Cost(trial, estimate->inlier);
        if (cost > equations.cost) {
          damping = std::max(damping, 1e-4) * 10.0;
          continue;
        }
        converged = equations.cost - cost < 1e-9 * (1.0 + equations.cost);
        estimate->a_from_b = trial;
        damping = std::max(1e-9, damping * 0.1);
        stepped = true;
      }
      if (!stepped || converged) return;
    }
  }

  const Pinhole& pinhole_a_;
  const Pinhole& pinhole_b_;
  std::span<const Sim3Match> matches_;
  const Sim3RefinementOptions& options_;
  double distance_weight_ = 1.0;
};

}  // namespace

Matrix27d ForwardReprojectionBySim3(const Pinhole& pinhole_a, const Vector3d& point_a) {
  Matrix27d j;
  j << ReprojectionByPose(pinhole_a, point_a), pinhole_a.ProjectJacobian(point_a) * point_a;
  return j;
}

Matrix27d BackwardReprojectionBySim3(const Pinhole& pinhole_b, const Sim3& a_from_b, const Vector3d& point_a) {
  // (Exp(x) S)^-1 p = S^-1 Exp(-x) p, and the linear part of S^-1 is R^T / s.
  Eigen::Matrix<double, 3, 7> moved;
  moved << Matrix3d::Identity(), -Hat(point_a), point_a;
  const Sim3 b_from_a = a_from_b.Inverse();
  return -pinhole_b.ProjectJacobian(b_from_a * point_a) * (b_from_a.scale() * b_from_a.RotationMatrix()) * moved;
}

Eigen::Matrix<double, 1, 7> LogDistanceBySim3(const Vector3d& moved) {
  Eigen::Matrix<double, 1, 7> j;
  j << moved.transpose() / moved.squaredNorm(), 0.0, 0.0, 0.0, 1.0;
  return j;
}

Sim3ChiSquares ChiSquaresOf(const Pinhole& pinhole_a, const Pinhole& pinhole_b, const Sim3& a_from_b,
                            const Sim3Match& match) {
  Sim3ChiSquares chi2;
  chi2.in_a = ChiSquare(pinhole_a, a_from_b * match.point_b, match.pixel_a, match.sigma_a_px);
  if (match.has_point_a && match.has_pixel_b) {
    chi2.in_b = ChiSquare(pinhole_b, a_from_b.Inverse() * match.point_a, match.pixel_b, match.sigma_b_px);
  }
  return chi2;
}

absl::Status Sim3RansacOptions::Validate() const {
  if (max_samples < 1) return InvalidSim3("max_samples must be at least 1");
  if (!(confidence > 0.0 && confidence < 1.0)) return InvalidSim3("confidence must be between 0 and 1");
  if (!(chi2_threshold > 0.0)) return InvalidSim3("chi2_threshold must be positive");
  if (min_inliers < 3) return InvalidSim3("min_inliers must be at least 3");
  return absl::OkStatus();
}

absl::Status Sim3RefinementOptions::Validate() const {
  if (rounds < 1) return InvalidSim3("rounds must be at least 1");
  if (iterations_per_round < 1) return InvalidSim3("iterations_per_round must be at least 1");
  if (!(chi2_threshold > 0.0)) return InvalidSim3("chi2_threshold must be positive");
  if (!(huber_threshold > 0.0)) return InvalidSim3("huber_threshold must be positive");
  if (!(min_distance_sigma > 0.0)) return InvalidSim3("min_distance_sigma must be positive");
  if (min_inliers < 4) return InvalidSim3("min_inliers must be at least 4");
  return absl::OkStatus();
}

absl::StatusOr<Sim3Estimate> FindSim3(const Pinhole& pinhole_a, const Pinhole& pinhole_b,
                                      std::span<const Sim3Match> matches, const Sim3RansacOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(Check(matches));
  std::vector<std::size_t> complete;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (matches[i].has_point_a) complete.push_back(i);
  }
  Sim3Estimate best;
  Random random(options.seed);
  double wanted = complete.size() >= 3 ? options.max_samples : 0.0;
  for (int sample = 0; sample < wanted; ++sample) {
    std::array<Vector3d, 3> in_a, in_b;
    for (std::size_t k = 0; k < 3; ++k) {
      // The first k places hold the sample so far.
      std::swap(complete[k], complete[k + random.Below(complete.size() - k)]);
      in_a[k] = matches[complete[k]].point_a;
      in_b[k] = matches[complete[k]].point_b;
    }
    const auto aligned = AlignPoints(in_a, in_b, {.min_spread_ratio = 1e-2});
    if (!aligned.ok()) continue;
    Sim3Estimate estimate{aligned->a_from_b, std::vector<std::uint8_t>(matches.size(), 0), 0};
    for (std::size_t i = 0; i < matches.size(); ++i) {
      if (!ChiSquaresOf(pinhole_a, pinhole_b, estimate.a_from_b, matches[i]).Within(options.chi2_threshold)) continue;
      estimate.inlier[i] = 1;
      ++estimate.num_inliers;
    }
    if (estimate.num_inliers <= best.num_inliers) continue;
    best = std::move(estimate);
    const double share = static_cast<double>(best.num_inliers) / static_cast<double>(matches.size());
    const double miss = std::log(std::max(1e-12, 1.0 - share * share * share));
    wanted = std::min<double>(options.max_samples, std::ceil(std::log(1.0 - options.confidence) / miss));
  }
  if (best.num_inliers < options.min_inliers) {
    return absl::FailedPreconditionError(absl::StrCat("sim3: ", best.num_inliers, " of ", matches.size(),
                                                      " matches agree, at least ", options.min_inliers, " needed"));
  }
  return best;
}

absl::StatusOr<Sim3Estimate> RefineSim3(const Pinhole& pinhole_a, const Pinhole& pinhole_b,
                                        const Sim3& initial_a_from_b, std::span<const Sim3Match> matches,
                                        const Sim3RefinementOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(Check(matches));
  return Refiner(pinhole_a, pinhole_b, matches, options).Run(initial_a_from_b);
}

}  // namespace cairn::optimization
