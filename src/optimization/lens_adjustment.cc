#include "optimization/lens_adjustment.h"

#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>
#include <memory>
#include <utility>

#include "optimization/ceres_costs.h"

namespace cairn::optimization {
namespace {

absl::Status InvalidLensProblem(const std::string& what) {
  return absl::InvalidArgumentError("lens adjustment: " + what);
}

class LensAdjuster {
 public:
  LensAdjuster(const BundleProblem& problem, std::uint32_t camera, std::span<const std::uint8_t> used,
               const LensAdjustmentOptions& options)
      : problem_(problem),
        camera_(camera),
        options_(options),
        prior_({options.log_focal_sigma, options.k1_sigma, options.k2_sigma}),
        points_(problem.points),
        blocks_(problem.poses.size()),
        ceres_problem_(Ownership()) {
    for (std::size_t i = 0; i < blocks_.size(); ++i) {
      internal::PoseToBlock(problem.poses[i].camera_from_map, blocks_[i].data());
    }
    Build(used);
  }

  absl::StatusOr<LensResult> Run() {
    if (free_observations_ <= 0) {
      return absl::FailedPreconditionError("lens adjustment: fewer observations than unknowns");
    }
    ceres::Solver::Options solver;
    solver.linear_solver_type = ceres::SPARSE_SCHUR;
    solver.sparse_linear_algebra_library_type = ceres::SUITE_SPARSE;
    solver.max_num_iterations = options_.max_iterations;
    solver.function_tolerance = options_.function_tolerance;
    solver.num_threads = 1;
    solver.logging_type = ceres::SILENT;
    // The same without a lens first: what that still finds is no merit of the lens.
    ceres::Solver::Summary without, with;
    ceres_problem_.SetParameterBlockConstant(lens_.data());
    solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>(*ordering_);  // Solve() changes it
    ceres::Solve(solver, &ceres_problem_, &without);
    ceres_problem_.SetParameterBlockVariable(lens_.data());
    solver.linear_solver_ordering = ordering_;
    ceres::Solve(solver, &ceres_problem_, &with);
    if (!without.IsSolutionUsable() || !with.IsSolutionUsable()) {
      return absl::InternalError("lens adjustment: the solver failed: " + with.message);
    }
    LensResult result;
    result.lens = {std::exp(lens_[0]), lens_[1], lens_[2]};
    for (const auto& block : blocks_) result.camera_from_map.push_back(internal::PoseFromBlock(block.data()));
    const double variance = 2.0 * with.final_cost / static_cast<double>(free_observations_);
    result.sigma_px = std::sqrt(variance);
    if (variance > 0.0) result.gain = 2.0 * (without.final_cost - with.final_cost) / variance;
    result.points = std::move(points_);
    return result;
  }

 private:
  static ceres::Problem::Options Ownership() {
    ceres::Problem::Options ownership;
    ownership.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ownership.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    ownership.disable_all_safety_checks = true;
    return ownership;
  }

  // Points are eliminated first. One ray does not make a point.
  void Build(std::span<const std::uint8_t> used) {
    std::vector<int> sights(points_.size(), 0);
    for (std::size_t i = 0; i < used.size(); ++i) sights[problem_.observations[i].point] += used[i] ? 1 : 0;
    std::vector<std::uint8_t> pose_used(blocks_.size(), 0);
    for (std::size_t p = 0; p < points_.size(); ++p) {
      if (sights[p] < 2) continue;
      ceres_problem_.AddParameterBlock(points_[p].data(), 3);
      ordering_->AddElementToGroup(points_[p].data(), 0);
      free_observations_ -= 3;
    }
    ceres_problem_.AddParameterBlock(lens_.data(), 3);
    ordering_->AddElementToGroup(lens_.data(), 1);
    for (std::size_t i = 0; i < used.size(); ++i) {
      const BundleObservation& o = problem_.observations[i];
      if (!used[i] || sights[o.point] < 2) continue;
      if (!std::exchange(pose_used[o.pose], 1)) AddPose(o.pose);
      const std::uint32_t camera = problem_.poses[o.pose].camera;
      double* pose = blocks_[o.pose].data();
      double* point = points_[o.point].data();
      if (camera == camera_) {
        lens_costs_.emplace_back(problem_.cameras[camera], o.pixel, o.sigma_px);
        ceres_problem_.AddResidualBlock(&lens_costs_.back(), nullptr, pose, point, lens_.data());
      } else {
        costs_.emplace_back(problem_.cameras[camera], o.pixel, o.sigma_px);
        ceres_problem_.AddResidualBlock(&costs_.back(), nullptr, pose, point);
      }
      free_observations_ += 2;
    }
    ceres_problem_.AddResidualBlock(&prior_, nullptr, lens_.data());
  }

  void AddPose(std::uint32_t pose) {
    double* block = blocks_[pose].data();
    ceres_problem_.AddParameterBlock(block, 7, &manifold_);
    ordering_->AddElementToGroup(block, 1);
    if (problem_.poses[pose].fixed) {
      ceres_problem_.SetParameterBlockConstant(block);
    } else {
      free_observations_ -= 6;
    }
  }

  const BundleProblem& problem_;
  const std::uint32_t camera_;
  const LensAdjustmentOptions& options_;
  internal::LeftIncrementManifold manifold_;
  internal::LensPriorCost prior_;
  std::deque<internal::ReprojectionCost> costs_;
  std::deque<internal::LensReprojectionCost> lens_costs_;
  std::vector<Vector3d> points_;
  std::vector<std::array<double, 7>> blocks_;
  std::array<double, 3> lens_ = {0.0, 0.0, 0.0};  // log focal_scale, k1, k2
  std::shared_ptr<ceres::ParameterBlockOrdering> ordering_ = std::make_shared<ceres::ParameterBlockOrdering>();
  std::int64_t free_observations_ = 0;  // residuals less unknowns
  ceres::Problem ceres_problem_;
};

}  // namespace

absl::Status LensAdjustmentOptions::Validate() const {
  if (max_iterations < 1) return InvalidLensProblem("max_iterations must be at least 1");
  if (!(function_tolerance > 0.0)) return InvalidLensProblem("function_tolerance must be positive");
  if (!(log_focal_sigma > 0.0 && k1_sigma > 0.0 && k2_sigma > 0.0))
    return InvalidLensProblem("the sigmas must be positive");
  return absl::OkStatus();
}

absl::StatusOr<LensResult> AdjustLens(const BundleProblem& problem, std::uint32_t camera,
                                      std::span<const std::uint8_t> used, const LensAdjustmentOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  CAIRN_RETURN_IF_ERROR(CheckProblem(problem));
  if (camera >= problem.cameras.size()) return InvalidLensProblem("the camera does not exist");
  if (used.size() != problem.observations.size())
    return InvalidLensProblem("`used` must have an entry per observation");
  return LensAdjuster(problem, camera, used, options).Run();
}

}  // namespace cairn::optimization
