#include "optimization/pose_covariance.h"

#include <Eigen/Dense>
#include <cmath>
#include <optional>
#include <utility>

#include "optimization/bundle_noise.h"
#include "optimization/reprojection.h"

namespace cairn::optimization {
namespace {

constexpr double kHuber = 2.4477;     // of residuals, times their noise
constexpr double kDegenerate = 1e-9;  // of a motion of all centres against the largest: it moves none of them

struct Block {
  Eigen::Index pose = 0;  // free
  Eigen::Matrix<double, 6, 3> pose_by_point;
};

class ReducedPoses {
 public:
  ReducedPoses(const BundleProblem& problem, std::span<const std::uint8_t> used) : problem_(problem), used_(used) {
    for (const BundlePose& pose : problem.poses) {
      free_.push_back(pose.fixed ? -1 : count_++);
      if (pose.fixed) held_ = true;
    }
  }

  int free_poses() const { return static_cast<int>(count_); }

  absl::StatusOr<PoseUncertainty> Compute() {
    const std::vector<double> chi2 = ChiSquares();
    PoseUncertainty result;
    result.noise_px = PixelNoise(problem_, kept_, chi2);
    if (!(result.noise_px > 0.0)) {
      return absl::FailedPreconditionError("uncertainty of poses: too few observations of points seen four times");
    }
    Reduce(chi2, kHuber * result.noise_px);
    gauge_ = MatrixXd::Zero(6 * count_, 7);
    if (!held_) FindGauge();
    // With the gauge's directions made stiff the equations have an inverse, from which these are taken again.
    Eigen::LLT<MatrixXd> solved(reduced_ + gauge_ * gauge_.transpose() * stiffness_);
    if (solved.info() != Eigen::Success) {
      return absl::FailedPreconditionError("uncertainty of poses: the observations leave some of them open");
    }
    covariance_ = solved.solve(MatrixXd::Identity(6 * count_, 6 * count_));
    if (!held_) Constrain();
    covariance_ *= result.noise_px * result.noise_px;
    for (std::size_t i = 0; i < problem_.poses.size(); ++i) result.poses.push_back(SigmaOf(free_[i]));
    return result;
  }

 private:
  using MatrixXd = Eigen::MatrixXd;

  std::vector<double> ChiSquares() {
    std::vector<double> chi2(problem_.observations.size(), 0.0);
    std::vector<int> sights(problem_.points.size(), 0);
    kept_.assign(used_.begin(), used_.end());
    for (std::size_t i = 0; i < chi2.size(); ++i) {
      const BundleObservation& o = problem_.observations[i];
      const BundlePose& pose = problem_.poses[o.pose];
      const Vector3d point_c = pose.camera_from_map * problem_.points[o.point];
      if (!InFront(point_c)) kept_[i] = 0;
      if (!kept_[i]) continue;
      chi2[i] = ReprojectionResidual(problem_.cameras[pose.camera], point_c, o.pixel).squaredNorm() /
                (o.sigma_px * o.sigma_px);
      ++sights[o.point];
    }
    for (std::size_t i = 0; i < chi2.size(); ++i) {
      if (sights[problem_.observations[i].point] < 2) kept_[i] = 0;
    }
    return chi2;
  }

  // The normal equations of the free poses, after their points have been eliminated.
  void Reduce(const std::vector<double>& chi2, double threshold) {
    reduced_ = MatrixXd::Zero(6 * count_, 6 * count_);
    std::vector<std::vector<std::size_t>> of_point(problem_.points.size());
    for (std::size_t i = 0; i < kept_.size(); ++i) {
      if (kept_[i]) of_point[problem_.observations[i].point].push_back(i);
    }
    const HuberLoss loss{threshold};
    std::vector<Block> blocks;
    for (const std::vector<std::size_t>& observations : of_point) {
      if (observations.empty()) continue;
      Matrix3d point = Matrix3d::Zero();
      blocks.clear();
      for (const std::size_t i : observations) {
        const BundleObservation& o = problem_.observations[i];
        const BundlePose& pose = problem_.poses[o.pose];
        const Pinhole& pinhole = problem_.cameras[pose.camera];
        const Vector3d point_c = pose.camera_from_map * problem_.points[o.point];
        const double weight = loss.Weight(chi2[i]) / (o.sigma_px * o.sigma_px);
        const Matrix23d by_point =
            ReprojectionByPoint(pinhole, pose.camera_from_map.rotation().toRotationMatrix(), point_c);
        point += weight * by_point.transpose() * by_point;
        const Eigen::Index at = free_[o.pose];
        if (at < 0) continue;
        const Matrix26d by_pose = ReprojectionByPose(pinhole, point_c);
        reduced_.block<6, 6>(6 * at, 6 * at) += weight * by_pose.transpose() * by_pose;
        blocks.push_back({at, weight * by_pose.transpose() * by_point});
      }
      const Matrix3d inverse = (point + 1e-9 * point.trace() * Matrix3d::Identity()).inverse();
      for (const Block& a : blocks) {
        const Eigen::Matrix<double, 6, 3> left = a.pose_by_point * inverse;
        for (const Block& b : blocks) {
          reduced_.block<6, 6>(6 * a.pose, 6 * b.pose) -= left * b.pose_by_point.transpose();
        }
      }
    }
  }

  // The increments of poses that a similarity of the map makes, orthonormal. A map point X moves by w x X + t + s X.
  void FindGauge() {
    MatrixXd motions(6 * count_, 7);
    for (std::size_t i = 0; i < problem_.poses.size(); ++i) {
      if (free_[i] < 0) continue;
      const Matrix3d r = problem_.poses[i].camera_from_map.rotation().toRotationMatrix();
      const Vector3d& t = problem_.poses[i].camera_from_map.translation();
      auto rows = motions.middleRows<6>(6 * free_[i]);
      rows.setZero();
      rows.block<3, 3>(0, 0) = -r;
      rows.block<3, 3>(0, 3) = -Hat(t) * r;
      rows.block<3, 3>(3, 3) = -r;
      rows.block<3, 1>(0, 6) = t;
    }
    gauge_ = Eigen::HouseholderQR<MatrixXd>(motions).householderQ() * MatrixXd::Identity(6 * count_, 7);
    stiffness_ = reduced_.trace() / static_cast<double>(6 * count_);
  }

  // From every error the similarity that takes most of it from the centres.
  void Constrain() {
    covariance_ -= gauge_ * gauge_.transpose() / stiffness_;
    MatrixXd centres(3 * count_, 7), from_increments = MatrixXd::Zero(3 * count_, 6 * count_);
    for (std::size_t i = 0; i < problem_.poses.size(); ++i) {
      if (free_[i] < 0) continue;
      from_increments.block<3, 3>(3 * free_[i], 6 * free_[i]) =
          -problem_.poses[i].camera_from_map.rotation().toRotationMatrix().transpose();
    }
    centres = from_increments * gauge_;
    Eigen::CompleteOrthogonalDecomposition<MatrixXd> fit;
    fit.setThreshold(kDegenerate);
    fit.compute(centres);
    const MatrixXd taken = gauge_ * fit.pseudoInverse() * from_increments;
    const MatrixXd once = covariance_ - taken * covariance_;
    covariance_ = once - once * taken.transpose();
  }

  PoseSigma SigmaOf(Eigen::Index pose) const {
    if (pose < 0) return {};
    // The centre moves by the translation, turned: the trace is the same.
    const auto variance = covariance_.diagonal().segment<6>(6 * pose);
    return {std::sqrt(std::max(0.0, variance.head<3>().sum()) / 3.0),
            std::sqrt(std::max(0.0, variance.tail<3>().sum()) / 3.0)};
  }

  const BundleProblem& problem_;
  const std::span<const std::uint8_t> used_;
  std::vector<std::uint8_t> kept_;
  std::vector<Eigen::Index> free_;  // per pose, -1: fixed
  Eigen::Index count_ = 0;
  bool held_ = false;
  MatrixXd reduced_, covariance_;
  MatrixXd gauge_;  // orthonormal columns; of none the product is zero
  double stiffness_ = 0.0;
};

}  // namespace

absl::StatusOr<PoseUncertainty> UncertaintyOfPoses(const BundleProblem& problem, std::span<const std::uint8_t> used,
                                                   int max_poses) {
  BundleProblem checked = problem;
  if (!checked.poses.empty()) checked.poses.front().fixed = true;
  CAIRN_RETURN_IF_ERROR(CheckProblem(checked));
  if (used.size() != problem.observations.size()) {
    return absl::InvalidArgumentError("uncertainty of poses: `used` must have an entry per observation");
  }
  ReducedPoses reduced(problem, used);
  if (reduced.free_poses() < 3 || reduced.free_poses() > max_poses) {
    return absl::FailedPreconditionError(
        absl::StrCat("uncertainty of poses: there are ", reduced.free_poses(), " free ones, not 3 to ", max_poses));
  }
  return reduced.Compute();
}

}  // namespace cairn::optimization
