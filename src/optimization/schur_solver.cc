#include "optimization/schur_solver.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>

#include "optimization/ceres_costs.h"

namespace cairn::optimization::internal {
namespace {

using Matrix63d = Eigen::Matrix<double, 6, 3>;

constexpr double kFirstDamping = 1e-4;  // share of the diagonal
constexpr double kMaxDamping = 1e8;
constexpr double kMinDiagonal = 1e-9;  // added to each, so that what no residual moves stays

// One observation, in the order of the points.
struct Sight {
  std::uint32_t pose = 0;
  std::int32_t free = -1;  // index among the free poses
  double u = 0.0, v = 0.0;
  double weight = 1.0;  // 1 / sigma
};

struct CameraState {
  Matrix3d rotation;
  Vector3d translation;
  const Pinhole* pinhole = nullptr;
};

class Solver {
 public:
  Solver(const BundleProblem& problem, std::span<const std::uint8_t> used, const SchurOptions& options,
         std::vector<SE3>* poses, std::vector<Vector3d>* points)
      : problem_(problem), options_(options), poses_(*poses), points_(*points) {
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      free_of_.push_back(problem.poses[i].fixed ? -1 : static_cast<std::int32_t>(pose_of_.size()));
      if (!problem.poses[i].fixed) pose_of_.push_back(static_cast<std::uint32_t>(i));
    }
    SortByPoint(used);
    for (const BundlePrior& prior : problem.priors) {
      priors_.emplace_back(prior.camera_from_map, prior.position_sigma, prior.rotation_sigma_rad);
    }
  }

  SchurSummary Run() {
    SchurSummary summary;
    cost_ = Cost(poses_, points_);
    summary.initial_cost = summary.final_cost = cost_;
    double damping = kFirstDamping, growth = 2.0;
    Linearize();
    for (int iteration = 0; iteration < options_.max_iterations; ++iteration) {
      if (options_.stop != nullptr && options_.stop->load(std::memory_order_relaxed)) break;
      double predicted = 0.0;
      if (!Step(damping, &predicted)) {
        if (summary.steps == 0 && damping > kMaxDamping) summary.usable = false;
        if (damping > kMaxDamping) break;
        damping *= growth;
        growth *= 2.0;
        continue;
      }
      const double trial = Cost(trial_poses_, trial_points_);
      const double gain = predicted > 0.0 ? (cost_ - trial) / predicted : -1.0;
      if (!(gain > 0.0)) {
        if (damping > kMaxDamping) break;
        damping *= growth;
        growth *= 2.0;
        continue;
      }
      const bool converged = cost_ - trial < options_.function_tolerance * cost_;
      poses_ = trial_poses_;
      points_ = trial_points_;
      cost_ = trial;
      ++summary.steps;
      damping *= std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3));
      growth = 2.0;
      if (converged || iteration + 1 == options_.max_iterations) break;
      Linearize();
    }
    summary.final_cost = cost_;
    return summary;
  }

 private:
  void SortByPoint(std::span<const std::uint8_t> used) {
    begin_.assign(points_.size() + 1, 0);
    for (std::size_t i = 0; i < used.size(); ++i) begin_[problem_.observations[i].point + 1] += used[i] ? 1 : 0;
    for (std::size_t p = 0; p < points_.size(); ++p) begin_[p + 1] += begin_[p];
    std::vector<std::uint32_t> at(begin_.begin(), begin_.end() - 1);
    sights_.resize(begin_.back());
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (!used[i]) continue;
      const BundleObservation& o = problem_.observations[i];
      sights_[at[o.point]++] = {o.pose, free_of_[o.pose], o.pixel.x(), o.pixel.y(), 1.0 / o.sigma_px};
    }
    cross_.resize(sights_.size());
  }

  void SetCameras(const std::vector<SE3>& poses) {
    cameras_.resize(poses.size());
    for (std::size_t i = 0; i < poses.size(); ++i) {
      cameras_[i] = {poses[i].RotationMatrix(), poses[i].translation(), &problem_.cameras[problem_.poses[i].camera]};
    }
  }

  // Half the sum of the losses; infinite with a point behind its camera.
  double Cost(const std::vector<SE3>& poses, const std::vector<Vector3d>& points) {
    SetCameras(poses);
    const HuberLoss loss{options_.huber_threshold};
    double sum = 0.0;
    for (std::size_t p = 0; p < points.size(); ++p) {
      for (std::uint32_t i = begin_[p]; i < begin_[p + 1]; ++i) {
        const Sight& sight = sights_[i];
        const CameraState& camera = cameras_[sight.pose];
        const Vector3d point_c = camera.rotation * points[p] + camera.translation;
        if (!InFront(point_c)) return std::numeric_limits<double>::infinity();
        const Vector2d residual = sight.weight * ReprojectionResidual(*camera.pinhole, point_c, {sight.u, sight.v});
        const double chi2 = residual.squaredNorm();
        sum += options_.huber_threshold > 0.0 ? loss.Value(chi2) : chi2;
      }
    }
    for (std::size_t i = 0; i < priors_.size(); ++i) {
      std::array<double, 7> block;
      Vector6d residual;
      PoseToBlock(poses[problem_.priors[i].pose], block.data());
      const double* parameters[1] = {block.data()};
      priors_[i].Evaluate(parameters, residual.data(), nullptr);
      sum += residual.squaredNorm();
    }
    return 0.5 * sum;
  }

  void Linearize() {
    SetCameras(poses_);
    pose_hessian_.assign(pose_of_.size(), Matrix6d::Zero());
    pose_gradient_.assign(pose_of_.size(), Vector6d::Zero());
    point_hessian_.assign(points_.size(), Matrix3d::Zero());
    point_gradient_.assign(points_.size(), Vector3d::Zero());
    const HuberLoss loss{options_.huber_threshold};
    for (std::size_t p = 0; p < points_.size(); ++p) {
      for (std::uint32_t i = begin_[p]; i < begin_[p + 1]; ++i) {
        const Sight& sight = sights_[i];
        const CameraState& camera = cameras_[sight.pose];
        const Vector3d point_c = camera.rotation * points_[p] + camera.translation;
        const Vector2d residual = ReprojectionResidual(*camera.pinhole, point_c, {sight.u, sight.v});
        double weight = sight.weight * sight.weight;
        if (options_.huber_threshold > 0.0) weight *= loss.Weight(weight * residual.squaredNorm());
        const Matrix23d by_point = ReprojectionByPoint(*camera.pinhole, camera.rotation, point_c);
        const Matrix23d weighted = weight * by_point;
        point_hessian_[p].noalias() += weighted.transpose() * by_point;
        point_gradient_[p].noalias() += weighted.transpose() * residual;
        if (sight.free < 0) continue;
        const Matrix26d by_pose = ReprojectionByPose(*camera.pinhole, point_c);
        const Matrix26d weighted_pose = weight * by_pose;
        pose_hessian_[sight.free].noalias() += weighted_pose.transpose() * by_pose;
        pose_gradient_[sight.free].noalias() += weighted_pose.transpose() * residual;
        cross_[i].noalias() = by_pose.transpose() * weighted;
      }
    }
    for (std::size_t i = 0; i < priors_.size(); ++i) AddPrior(i);
  }

  void AddPrior(std::size_t index) {
    const std::uint32_t pose = problem_.priors[index].pose;
    if (free_of_[pose] < 0) return;
    std::array<double, 7> block;
    Vector6d residual;
    Eigen::Matrix<double, 6, 7, Eigen::RowMajor> jacobian;
    PoseToBlock(poses_[pose], block.data());
    const double* parameters[1] = {block.data()};
    double* jacobians[1] = {jacobian.data()};
    priors_[index].Evaluate(parameters, residual.data(), jacobians);
    const Matrix6d j = jacobian.leftCols<6>();
    pose_hessian_[free_of_[pose]] += j.transpose() * j;
    pose_gradient_[free_of_[pose]] += j.transpose() * residual;
  }

  // The trial poses and points, and by how much the cost should fall.
  bool Step(double damping, double* predicted) {
    const auto n = static_cast<Eigen::Index>(6 * pose_of_.size());
    reduced_.setZero(n, n);
    right_.setZero(n);
    for (Eigen::Index c = 0; c < n / 6; ++c) {
      Matrix6d block = pose_hessian_[c];
      block.diagonal() += damping * block.diagonal() + Vector6d::Constant(kMinDiagonal);
      reduced_.block<6, 6>(6 * c, 6 * c) = block;
      right_.segment<6>(6 * c) = -pose_gradient_[c];
    }
    inverse_.resize(points_.size());
    for (std::size_t p = 0; p < points_.size(); ++p) {
      if (begin_[p] == begin_[p + 1]) continue;
      Matrix3d block = point_hessian_[p];
      block.diagonal() += damping * block.diagonal() + Vector3d::Constant(kMinDiagonal);
      inverse_[p] = block.inverse();
      if (!inverse_[p].allFinite()) return false;
      for (std::uint32_t i = begin_[p]; i < begin_[p + 1]; ++i) {
        if (sights_[i].free < 0) continue;
        const Matrix63d eliminated = cross_[i] * inverse_[p];
        const Eigen::Index row = 6 * sights_[i].free;
        right_.segment<6>(row).noalias() += eliminated * point_gradient_[p];
        for (std::uint32_t j = begin_[p]; j < begin_[p + 1]; ++j) {
          const Eigen::Index column = 6 * sights_[j].free;
          // The lower triangle is enough.
          if (sights_[j].free < 0 || column > row) continue;
          reduced_.block<6, 6>(row, column).noalias() -= eliminated.lazyProduct(cross_[j].transpose());
        }
      }
    }
    if (n > 0) {
      const Eigen::LLT<Eigen::MatrixXd, Eigen::Lower> factor(reduced_);
      if (factor.info() != Eigen::Success) return false;
      right_ = factor.solve(right_);
      if (!right_.allFinite()) return false;
    }
    Apply(damping, predicted);
    return true;
  }

  // Poses by `right_`, points by back substitution. The model's fall is half of x^T (damping D x - g).
  void Apply(double damping, double* predicted) {
    double fall = 0.0;
    trial_poses_ = poses_;
    trial_points_ = points_;
    for (std::size_t c = 0; c < pose_of_.size(); ++c) {
      const Vector6d step = right_.segment<6>(static_cast<Eigen::Index>(6 * c));
      trial_poses_[pose_of_[c]] = SE3::Exp(step) * poses_[pose_of_[c]];
      fall += step.dot(damping * pose_hessian_[c].diagonal().cwiseProduct(step) - pose_gradient_[c]);
    }
    for (std::size_t p = 0; p < points_.size(); ++p) {
      if (begin_[p] == begin_[p + 1]) continue;
      Vector3d left = -point_gradient_[p];
      for (std::uint32_t i = begin_[p]; i < begin_[p + 1]; ++i) {
        if (sights_[i].free >= 0) {
          left.noalias() -= cross_[i].transpose() * right_.segment<6>(6 * static_cast<Eigen::Index>(sights_[i].free));
        }
      }
      const Vector3d step = inverse_[p] * left;
      trial_points_[p] += step;
      fall += step.dot(damping * point_hessian_[p].diagonal().cwiseProduct(step) - point_gradient_[p]);
    }
    *predicted = 0.5 * fall;
  }

  const BundleProblem& problem_;
  const SchurOptions options_;
  std::vector<SE3>& poses_;
  std::vector<Vector3d>& points_;
  std::vector<std::int32_t> free_of_;   // per pose
  std::vector<std::uint32_t> pose_of_;  // per free pose
  std::vector<std::uint32_t> begin_;    // per point, into sights_
  std::vector<Sight> sights_;
  std::deque<PosePriorCost> priors_;

  double cost_ = 0.0;
  std::vector<CameraState> cameras_;
  std::vector<Matrix6d> pose_hessian_;
  std::vector<Vector6d> pose_gradient_;
  std::vector<Matrix3d> point_hessian_, inverse_;
  std::vector<Vector3d> point_gradient_;
  std::vector<Matrix63d> cross_;  // per sight of a free pose
  Eigen::MatrixXd reduced_;
  Eigen::VectorXd right_;
  std::vector<SE3> trial_poses_;
  std::vector<Vector3d> trial_points_;
};

}  // namespace

SchurSummary MinimizeBundle(const BundleProblem& problem, std::span<const std::uint8_t> used,
                            const SchurOptions& options, std::vector<SE3>* poses, std::vector<Vector3d>* points) {
  return Solver(problem, used, options, poses, points).Run();
}

}  // namespace cairn::optimization::internal
