#include "optimization/schur_solver.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <limits>

#include "base/cpu_features.h"
#include "optimization/ceres_costs.h"
#include "optimization/schur_kernel.h"

namespace cairn::optimization::internal {
namespace {

// A padded column or block of the kernels.
using PaddedMap = Eigen::Map<Matrix6d, 0, Eigen::OuterStride<kPadded>>;
using PaddedColumn = Eigen::Map<Vector6d>;

constexpr double kFirstDamping = 1e-4;  // share of the diagonal
constexpr double kMinDamping = 1e-9;    // what no residual tells, such as the scale of a map, stays where it is
constexpr double kMaxDamping = 1e8;
constexpr double kMinDiagonal = 1e-9;  // added to each, so that what no residual moves stays

class Solver {
 public:
  Solver(const BundleProblem& problem, std::span<const std::uint8_t> used, const SchurOptions& options,
         std::vector<SE3>* poses, std::vector<Vector3d>* points)
      : problem_(problem),
        options_(options),
        kernel_(SchurKernelFor(ActiveSimdLevel())),
        poses_(*poses),
        points_(*points) {
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      free_of_.push_back(problem.poses[i].fixed ? -1 : static_cast<std::int32_t>(pose_of_.size()));
      if (!problem.poses[i].fixed) pose_of_.push_back(static_cast<std::uint32_t>(i));
    }
    SortByPoint(used);
    for (const BundlePrior& prior : problem.priors) {
      priors_.emplace_back(prior.camera_from_map, prior.position_sigma, prior.rotation_sigma_rad);
    }
    for (std::size_t i = 0; options.rotation_sigma_rad > 0.0 && i < problem.rotations.size(); ++i) {
      const BundleRotation& rotation = problem.rotations[i];
      rotations_.emplace_back(rotation.b_from_a, options.rotation_sigma_rad * std::sqrt(rotation.steps));
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
      damping = std::max(kMinDamping, damping * std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3)));
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
    // Free poses first, ascending: as unsigned, what is fixed is the greatest.
    const auto order = [](const SchurSight& s) { return static_cast<std::uint32_t>(s.free); };
    free_count_.assign(points_.size(), 0);
    for (std::size_t p = 0; p < points_.size(); ++p) {
      std::sort(sights_.begin() + begin_[p], sights_.begin() + begin_[p + 1],
                [&](const SchurSight& a, const SchurSight& b) { return order(a) < order(b); });
      for (std::uint32_t i = begin_[p]; i < begin_[p + 1]; ++i) free_count_[p] += sights_[i].free >= 0 ? 1 : 0;
    }
    cross_.resize(sights_.size() * kCrossBlock);
  }

  SchurPoint PointAt(std::size_t p) const {
    return {sights_.data() + begin_[p], static_cast<int>(begin_[p + 1] - begin_[p]), free_count_[p]};
  }
  double* CrossOf(std::size_t p) { return cross_.data() + static_cast<std::size_t>(begin_[p]) * kCrossBlock; }
  PaddedMap PoseHessian(std::size_t c) { return PaddedMap(pose_hessian_.data() + c * kPoseBlock); }
  PaddedColumn PoseGradient(std::size_t c) { return PaddedColumn(pose_gradient_.data() + c * kPadded); }

  void SetCameras(const std::vector<SE3>& poses) {
    cameras_.resize(poses.size());
    for (std::size_t i = 0; i < poses.size(); ++i) {
      SchurCamera& camera = cameras_[i];
      Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(camera.rotation) = poses[i].RotationMatrix();
      Eigen::Map<Vector3d>(camera.translation) = poses[i].translation();
      const Pinhole& pinhole = problem_.cameras[problem_.poses[i].camera];
      camera.fx = pinhole.fx_px, camera.fy = pinhole.fy_px, camera.cx = pinhole.cx_px, camera.cy = pinhole.cy_px;
    }
  }

  // Half the sum of the losses; infinite with a point behind its camera.
  double Cost(const std::vector<SE3>& poses, const std::vector<Vector3d>& points) {
    SetCameras(poses);
    const HuberLoss loss{options_.huber_threshold};
    double sum = 0.0;
    for (std::size_t p = 0; p < points.size(); ++p) {
      for (std::uint32_t i = begin_[p]; i < begin_[p + 1]; ++i) {
        const SchurSight& sight = sights_[i];
        const SchurCamera& camera = cameras_[sight.pose];
        const double* r = camera.rotation;
        const Vector3d& at = points[p];
        const double x = r[0] * at.x() + r[1] * at.y() + r[2] * at.z() + camera.translation[0];
        const double y = r[3] * at.x() + r[4] * at.y() + r[5] * at.z() + camera.translation[1];
        const double z = r[6] * at.x() + r[7] * at.y() + r[8] * at.z() + camera.translation[2];
        if (!InFront({x, y, z})) return std::numeric_limits<double>::infinity();
        const double iz = 1.0 / z;
        const double eu = sight.weight * (camera.fx * x * iz + camera.cx - sight.u);
        const double ev = sight.weight * (camera.fy * y * iz + camera.cy - sight.v);
        const double chi2 = eu * eu + ev * ev;
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
    const HuberLoss rotation_loss{options_.rotation_threshold};
    for (std::size_t i = 0; i < rotations_.size(); ++i) {
      const BundleRotation& rotation = problem_.rotations[i];
      const double chi2 =
          rotations_[i]
              .Residual(poses[rotation.pose_a].rotation(), poses[rotation.pose_b].rotation(), nullptr, nullptr)
              .squaredNorm();
      sum += options_.rotation_threshold > 0.0 ? rotation_loss.Value(chi2) : chi2;
    }
    return 0.5 * sum;
  }

  void Linearize() {
    SetCameras(poses_);
    pose_hessian_.assign(pose_of_.size() * kPoseBlock, 0.0);
    pose_gradient_.assign(pose_of_.size() * kPadded, 0.0);
    point_hessian_.resize(points_.size());
    point_gradient_.resize(points_.size());
    for (std::size_t p = 0; p < points_.size(); ++p) {
      kernel_.linearize(PointAt(p), cameras_.data(), points_[p].data(), options_.huber_threshold, pose_hessian_.data(),
                        pose_gradient_.data(), point_hessian_[p].data(), point_gradient_[p].data(), CrossOf(p));
    }
    for (std::size_t i = 0; i < priors_.size(); ++i) AddPrior(i);
    rotation_cross_.assign(rotations_.size(), Matrix3d::Zero());
    for (std::size_t i = 0; i < rotations_.size(); ++i) AddRotation(i);
  }

  void AddRotation(std::size_t index) {
    const BundleRotation& rotation = problem_.rotations[index];
    const std::int32_t a = free_of_[rotation.pose_a], b = free_of_[rotation.pose_b];
    Matrix3d by_a, by_b;
    const Vector3d residual = rotations_[index].Residual(poses_[rotation.pose_a].rotation(),
                                                         poses_[rotation.pose_b].rotation(), &by_a, &by_b);
    const double weight =
        options_.rotation_threshold > 0.0 ? HuberLoss{options_.rotation_threshold}.Weight(residual.squaredNorm()) : 1.0;
    if (a >= 0) {
      PoseHessian(a).block<3, 3>(3, 3) += weight * by_a.transpose() * by_a;
      PoseGradient(a).segment<3>(3) += weight * by_a.transpose() * residual;
    }
    if (b >= 0) {
      PoseHessian(b).block<3, 3>(3, 3) += weight * by_b.transpose() * by_b;
      PoseGradient(b).segment<3>(3) += weight * by_b.transpose() * residual;
    }
    rotation_cross_[index] = weight * by_a.transpose() * by_b;
  }

  // Into the lower triangle.
  void AddRotationCross() {
    for (std::size_t i = 0; i < rotations_.size(); ++i) {
      const std::int32_t a = free_of_[problem_.rotations[i].pose_a], b = free_of_[problem_.rotations[i].pose_b];
      if (a < 0 || b < 0) continue;
      const Eigen::Index at_a = 6 * a + 3, at_b = 6 * b + 3;
      if (a > b) reduced_.block<3, 3>(at_a, at_b) += rotation_cross_[i];
      if (b > a) reduced_.block<3, 3>(at_b, at_a) += rotation_cross_[i].transpose();
    }
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
    PoseHessian(free_of_[pose]) += j.transpose() * j;
    PoseGradient(free_of_[pose]) += j.transpose() * residual;
  }

  // The trial poses and points, and by how much the cost should fall.
  bool Step(double damping, double* predicted) {
    const std::size_t free = pose_of_.size();
    const auto n = static_cast<Eigen::Index>(6 * free);
    blocks_.assign(free * (free + 1) / 2 * kPoseBlock, 0.0);
    column_.assign(free * kPadded, 0.0);
    inverse_.resize(points_.size());
    for (std::size_t p = 0; p < points_.size(); ++p) {
      if (begin_[p] == begin_[p + 1]) continue;
      Matrix3d block = point_hessian_[p];
      block.diagonal() += damping * block.diagonal() + Vector3d::Constant(kMinDiagonal);
      inverse_[p] = block.inverse();
      if (!inverse_[p].allFinite()) return false;
      kernel_.eliminate(PointAt(p), inverse_[p].data(), point_gradient_[p].data(), CrossOf(p), blocks_.data(),
                        column_.data());
    }
    reduced_.resize(n, n);  // the lower triangle is enough
    right_.resize(n);
    for (std::size_t row = 0; row < free; ++row) {
      const auto at = static_cast<Eigen::Index>(6 * row);
      for (std::size_t column = 0; column <= row; ++column) {
        reduced_.block<6, 6>(at, static_cast<Eigen::Index>(6 * column)) =
            PaddedMap(blocks_.data() + (row * (row + 1) / 2 + column) * kPoseBlock);
      }
      Matrix6d own = PoseHessian(row);
      own.diagonal() += damping * own.diagonal() + Vector6d::Constant(kMinDiagonal);
      reduced_.block<6, 6>(at, at) += own;
      right_.segment<6>(at) = PaddedColumn(column_.data() + row * kPadded) - PoseGradient(row);
    }
    AddRotationCross();
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
      fall += step.dot(damping * PoseHessian(c).diagonal().cwiseProduct(step) - PoseGradient(c));
    }
    for (std::size_t p = 0; p < points_.size(); ++p) {
      if (begin_[p] == begin_[p + 1]) continue;
      Vector3d left = -point_gradient_[p];
      const double* cross = CrossOf(p);
      for (int i = 0; i < free_count_[p]; ++i, cross += kCrossBlock) {
        const Eigen::Map<const Eigen::Matrix<double, 6, 3>, 0, Eigen::OuterStride<kPadded>> by_point(cross);
        const auto at = 6 * static_cast<Eigen::Index>(sights_[begin_[p] + static_cast<std::uint32_t>(i)].free);
        left.noalias() -= by_point.transpose() * right_.segment<6>(at);
      }
      const Vector3d step = inverse_[p] * left;
      trial_points_[p] += step;
      fall += step.dot(damping * point_hessian_[p].diagonal().cwiseProduct(step) - point_gradient_[p]);
    }
    *predicted = 0.5 * fall;
  }

  const BundleProblem& problem_;
  const SchurOptions options_;
  const SchurKernel kernel_;
  std::vector<SE3>& poses_;
  std::vector<Vector3d>& points_;
  std::vector<std::int32_t> free_of_;   // per pose
  std::vector<std::uint32_t> pose_of_;  // per free pose
  std::vector<std::uint32_t> begin_;    // per point, into sights_
  std::vector<SchurSight> sights_;
  std::vector<int> free_count_;  // per point, of its sights
  std::deque<PosePriorCost> priors_;
  std::deque<RelativeRotationCost> rotations_;
  std::vector<Matrix3d> rotation_cross_;  // between the rotations of both poses of each

  double cost_ = 0.0;
  std::vector<SchurCamera> cameras_;  // per pose
  std::vector<double> pose_hessian_, pose_gradient_;
  std::vector<Matrix3d> point_hessian_, inverse_;
  std::vector<Vector3d> point_gradient_;
  std::vector<double> cross_;            // a block per sight
  std::vector<double> blocks_, column_;  // the Schur complement
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
