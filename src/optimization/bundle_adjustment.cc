#include "optimization/bundle_adjustment.h"

#include <ceres/iteration_callback.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <memory>
#include <optional>

#include "optimization/bundle_noise.h"
#include "optimization/ceres_costs.h"
#include "optimization/schur_solver.h"

namespace cairn::optimization {
namespace {

using internal::PoseFromBlock;
using internal::PoseToBlock;

absl::Status Invalid(const std::string& what) { return absl::InvalidArgumentError("bundle adjustment: " + what); }

constexpr double kRotationThreshold = 2.7955;  // sqrt(7.815): chi-square of 3 degrees of freedom, 95 %

class StopCallback final : public ceres::IterationCallback {
 public:
  explicit StopCallback(const std::atomic<bool>* stop) : stop_(stop) {}
  ceres::CallbackReturnType operator()(const ceres::IterationSummary&) override {
    return stop_->load(std::memory_order_relaxed) ? ceres::SOLVER_TERMINATE_SUCCESSFULLY : ceres::SOLVER_CONTINUE;
  }

 private:
  const std::atomic<bool>* stop_;
};

class Adjuster {
 public:
  Adjuster(const BundleProblem& problem, const BundleAdjustmentOptions& options)
      : problem_(problem), options_(options), points_(problem.points), inlier_(problem.observations.size(), 1) {
    for (const BundlePose& pose : problem.poses) poses_.push_back(pose.camera_from_map);
  }

  absl::StatusOr<BundleResult> Run() {
    BundleResult result;
    // A point behind a camera has no residual to start from.
    for (std::size_t i = 0; i < inlier_.size(); ++i) inlier_[i] = std::isfinite(ChiSquare(i)) ? 1 : 0;
    DropLonePoints();
    CAIRN_RETURN_IF_ERROR(Round(options_.huber_threshold, options_.first_iterations, &result));
    Classify();
    if (options_.second_iterations > 0 && !Stopped()) {
      DropLonePoints();
      CAIRN_RETURN_IF_ERROR(Round(0.0, options_.second_iterations, &result));
      Classify();
    }
    if (options_.noise_iterations > 0 && !Stopped()) CAIRN_RETURN_IF_ERROR(RoundsWithNoise(&result));
    result.interrupted = Stopped();
    double chi2 = 0.0;
    for (std::size_t i = 0; i < inlier_.size(); ++i) {
      if (!inlier_[i]) continue;
      ++result.num_inliers;
      chi2 += ChiSquare(i);
    }
    result.final_cost = 0.5 * chi2;
    if (result.num_inliers > 0) result.inlier_rmse = std::sqrt(chi2 / result.num_inliers);
    result.camera_from_map = std::move(poses_);
    result.points = std::move(points_);
    result.inlier = std::move(inlier_);
    return result;
  }

 private:
  bool Stopped() const { return options_.stop != nullptr && options_.stop->load(std::memory_order_relaxed); }

  // Of the whitened residual; infinite behind the camera.
  double ChiSquare(std::size_t index) const {
    const BundleObservation& o = problem_.observations[index];
    const Vector3d point_c = poses_[o.pose] * points_[o.point];
    if (!InFront(point_c)) return std::numeric_limits<double>::infinity();
    const Pinhole& pinhole = problem_.cameras[problem_.poses[o.pose].camera];
    return ReprojectionResidual(pinhole, point_c, o.pixel).squaredNorm() / (o.sigma_px * o.sigma_px);
  }

  void Classify() {
    for (std::size_t i = 0; i < inlier_.size(); ++i) inlier_[i] = ChiSquare(i) <= options_.chi2_threshold ? 1 : 0;
  }

  // One ray does not make a point: such observations take no part in the next round.
  void DropLonePoints() {
    std::vector<int> count(points_.size(), 0);
    for (std::size_t i = 0; i < inlier_.size(); ++i) count[problem_.observations[i].point] += inlier_[i];
    for (std::size_t i = 0; i < inlier_.size(); ++i) {
      if (count[problem_.observations[i].point] < 2) inlier_[i] = 0;
    }
  }

  // What is left to weigh the observations by is what they show themselves: sigma_px tells the octaves apart, but a
  // corner is found several times more precisely than it says, and what is wrong by half a pixel is wrong.
  absl::Status RoundsWithNoise(BundleResult* result) {
    DropLonePoints();
    std::vector<double> chi2(inlier_.size());
    for (std::size_t i = 0; i < inlier_.size(); ++i) chi2[i] = ChiSquare(i);
    result->noise_px = PixelNoise(problem_, inlier_, chi2);
    if (!(result->noise_px > 0.0)) return absl::OkStatus();
    const double threshold = options_.huber_threshold * result->noise_px;
    CAIRN_RETURN_IF_ERROR(Round(threshold, options_.noise_iterations, result));
    result->rotation_noise_rad = RotationNoise(problem_, poses_);
    if (result->rotation_noise_rad > 0.0 && !Stopped()) {
      // Observations stay whitened by sigma_px alone.
      rotation_sigma_rad_ = result->rotation_noise_rad / result->noise_px;
      rotation_threshold_ = kRotationThreshold * result->noise_px;
      CAIRN_RETURN_IF_ERROR(Round(threshold, options_.noise_iterations, result));
    }
    Classify();
    return absl::OkStatus();
  }

  // `huber_threshold`: 0 for the squared loss.
  absl::Status Round(double huber_threshold, int iterations, BundleResult* result) {
    const auto free_poses =
        std::count_if(problem_.poses.begin(), problem_.poses.end(), [](const BundlePose& pose) { return !pose.fixed; });
    if (free_poses > options_.max_dense_poses) return SparseRound(huber_threshold, iterations, result);
    internal::SchurOptions options;
    options.max_iterations = iterations;
    options.huber_threshold = huber_threshold;
    options.rotation_sigma_rad = rotation_sigma_rad_;
    options.rotation_threshold = rotation_threshold_;
    options.function_tolerance = options_.function_tolerance;
    options.stop = options_.stop;
    const internal::SchurSummary summary = internal::MinimizeBundle(problem_, inlier_, options, &poses_, &points_);
    if (!summary.usable) return absl::InternalError("bundle adjustment: the equations have no solution");
    if (result->iterations == 0) result->initial_cost = summary.initial_cost;
    result->iterations += summary.steps;
    return absl::OkStatus();
  }

  // With many poses the reduced equations are sparse: a matter for Ceres and SuiteSparse.
  absl::Status SparseRound(double huber_threshold, int iterations, BundleResult* result) {
    ceres::Problem::Options ownership;
    ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ownership.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ownership.disable_all_safety_checks = true;
    ceres::Problem problem(ownership);
    internal::LeftIncrementManifold manifold;
    std::optional<ceres::HuberLoss> huber, rotation_huber;
    if (huber_threshold > 0.0) huber.emplace(huber_threshold);
    if (rotation_threshold_ > 0.0) rotation_huber.emplace(rotation_threshold_);
    std::deque<internal::ReprojectionCost> costs;
    std::deque<internal::PosePriorCost> priors;
    std::deque<internal::RelativeRotationCost> rotations;
    std::vector<std::array<double, 7>> blocks(poses_.size());
    for (std::size_t i = 0; i < poses_.size(); ++i) PoseToBlock(poses_[i], blocks[i].data());
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    AddBlocks(&blocks, &manifold, &problem, ordering.get());
    for (std::size_t i = 0; i < inlier_.size(); ++i) {
      const BundleObservation& o = problem_.observations[i];
      if (!inlier_[i]) continue;
      const Pinhole& pinhole = problem_.cameras[problem_.poses[o.pose].camera];
      costs.emplace_back(pinhole, o.pixel, o.sigma_px);
      problem.AddResidualBlock(&costs.back(), huber ? &*huber : nullptr, blocks[o.pose].data(),
                               points_[o.point].data());
    }
    for (const BundlePrior& prior : problem_.priors) {
      priors.emplace_back(prior.camera_from_map, prior.position_sigma, prior.rotation_sigma_rad);
      problem.AddResidualBlock(&priors.back(), nullptr, blocks[prior.pose].data());
    }
    for (std::size_t i = 0; rotation_sigma_rad_ > 0.0 && i < problem_.rotations.size(); ++i) {
      const BundleRotation& rotation = problem_.rotations[i];
      rotations.emplace_back(rotation.b_from_a, rotation_sigma_rad_ * std::sqrt(rotation.steps));
      problem.AddResidualBlock(&rotations.back(), rotation_huber ? &*rotation_huber : nullptr,
                               blocks[rotation.pose_a].data(), blocks[rotation.pose_b].data());
    }
    if (problem.NumResidualBlocks() == 0) return absl::OkStatus();

    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_SCHUR;
    solver.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
    solver.linear_solver_ordering = ordering;
    solver.max_num_iterations = iterations;
    solver.function_tolerance = options_.function_tolerance;
    solver.num_threads = 1;
    solver.logging_type = ceres::SILENT;
    StopCallback stop(options_.stop);
    if (options_.stop != nullptr) solver.callbacks.push_back(&stop);
    ceres::Solver::Summary summary;
    ceres::Solve(solver, &problem, &summary);
    if (!summary.IsSolutionUsable()) {
      return absl::InternalError("bundle adjustment: the solver failed: " + summary.message);
    }
    for (std::size_t i = 0; i < poses_.size(); ++i) poses_[i] = PoseFromBlock(blocks[i].data());
    if (result->iterations == 0) result->initial_cost = summary.initial_cost;
    // Iteration 0 is the evaluation of the start.
    result->iterations += std::max(0, summary.num_successful_steps - 1);
    return absl::OkStatus();
  }

  // Points are eliminated first.
  void AddBlocks(std::vector<std::array<double, 7>>* blocks, ceres::Manifold* manifold, ceres::Problem* problem,
                 ceres::ParameterBlockOrdering* ordering) {
    std::vector<std::uint8_t> pose_used(poses_.size(), 0), point_used(points_.size(), 0);
    for (std::size_t i = 0; i < inlier_.size(); ++i) {
      const BundleObservation& o = problem_.observations[i];
      if (inlier_[i]) pose_used[o.pose] = point_used[o.point] = 1;
    }
    for (const BundlePrior& prior : problem_.priors) pose_used[prior.pose] = 1;
    for (const BundleRotation& rotation : problem_.rotations) {
      if (rotation_sigma_rad_ > 0.0) pose_used[rotation.pose_a] = pose_used[rotation.pose_b] = 1;
    }
    for (std::size_t i = 0; i < points_.size(); ++i) {
      if (!point_used[i]) continue;
      problem->AddParameterBlock(points_[i].data(), 3);
      ordering->AddElementToGroup(points_[i].data(), 0);
    }
    for (std::size_t i = 0; i < blocks->size(); ++i) {
      if (!pose_used[i]) continue;
      double* block = (*blocks)[i].data();
      problem->AddParameterBlock(block, 7, manifold);
      ordering->AddElementToGroup(block, 1);
      if (problem_.poses[i].fixed) problem->SetParameterBlockConstant(block);
    }
  }

  const BundleProblem& problem_;
  const BundleAdjustmentOptions& options_;
  std::vector<SE3> poses_;
  std::vector<Vector3d> points_;
  std::vector<std::uint8_t> inlier_;
  double rotation_sigma_rad_ = 0.0;  // of one step of the problem's rotations, as the cost takes it; 0: without them
  double rotation_threshold_ = 0.0;  // of Huber's loss on them
};

}  // namespace

absl::Status BundleAdjustmentOptions::Validate() const {
  if (first_iterations < 1) return Invalid("first_iterations must be at least 1");
  if (second_iterations < 0) return Invalid("second_iterations must not be negative");
  if (noise_iterations < 0) return Invalid("noise_iterations must not be negative");
  if (!(chi2_threshold > 0.0)) return Invalid("chi2_threshold must be positive");
  if (!(huber_threshold > 0.0)) return Invalid("huber_threshold must be positive");
  if (max_dense_poses < 0) return Invalid("max_dense_poses must not be negative");
  if (!(function_tolerance > 0.0)) return Invalid("function_tolerance must be positive");
  return absl::OkStatus();
}

absl::Status CheckProblem(const BundleProblem& problem) {
  bool anchored = false, free = !problem.points.empty();
  for (std::size_t i = 0; i < problem.poses.size(); ++i) {
    const BundlePose& pose = problem.poses[i];
    if (pose.camera >= problem.cameras.size()) return Invalid(absl::StrCat("pose ", i, " has no camera"));
    if (!pose.camera_from_map.Matrix().allFinite()) return Invalid(absl::StrCat("pose ", i, " is not finite"));
    anchored |= pose.fixed;
    free |= !pose.fixed;
  }
  for (std::size_t i = 0; i < problem.points.size(); ++i) {
    if (!problem.points[i].allFinite()) return Invalid(absl::StrCat("point ", i, " is not finite"));
  }
  for (std::size_t i = 0; i < problem.observations.size(); ++i) {
    const BundleObservation& o = problem.observations[i];
    if (o.pose >= problem.poses.size() || o.point >= problem.points.size()) {
      return Invalid(absl::StrCat("observation ", i, " refers to a pose or point that does not exist"));
    }
    if (!o.pixel.allFinite() || !(o.sigma_px > 0.0) || !std::isfinite(o.sigma_px)) {
      return Invalid(absl::StrCat("observation ", i, " is not finite or its sigma_px is not positive"));
    }
  }
  for (std::size_t i = 0; i < problem.priors.size(); ++i) {
    const BundlePrior& prior = problem.priors[i];
    if (prior.pose >= problem.poses.size()) return Invalid(absl::StrCat("prior ", i, " refers to no pose"));
    if (!prior.camera_from_map.Matrix().allFinite() || !(prior.position_sigma > 0.0) ||
        !(prior.rotation_sigma_rad > 0.0)) {
      return Invalid(absl::StrCat("prior ", i, " is not finite or a sigma is not positive"));
    }
    anchored = true;
  }
  for (std::size_t i = 0; i < problem.rotations.size(); ++i) {
    const BundleRotation& rotation = problem.rotations[i];
    if (rotation.pose_a >= problem.poses.size() || rotation.pose_b >= problem.poses.size() ||
        rotation.pose_a == rotation.pose_b) {
      return Invalid(absl::StrCat("rotation ", i, " does not relate two poses"));
    }
    if (!rotation.b_from_a.coeffs().allFinite() || !(rotation.steps > 0.0)) {
      return Invalid(absl::StrCat("rotation ", i, " is not finite or its steps are not positive"));
    }
  }
  if (!free) return absl::FailedPreconditionError("bundle adjustment: nothing to adjust");
  if (!anchored) return absl::FailedPreconditionError("bundle adjustment: no pose is fixed or has a prior");
  return absl::OkStatus();
}

absl::StatusOr<BundleResult> AdjustBundle(const BundleProblem& problem, const BundleAdjustmentOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(CheckProblem(problem));
  return Adjuster(problem, options).Run();
}

}  // namespace cairn::optimization
