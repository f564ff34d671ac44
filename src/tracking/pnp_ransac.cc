#include "tracking/pnp_ransac.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/random.h"
#include "geometry/p3p.h"

namespace cairn::tracking {
namespace {

using optimization::PoseObservation;

constexpr int kSampleSize = 3;
constexpr int kFirstPool = 15;     // samples come from so many best matches at first,
constexpr double kPoolGrowth = 1;  // and from so many more with each iteration
constexpr int kLocalOptimizations = 20;

class Ransac {
 public:
  Ransac(const Pinhole& pinhole, std::span<const PoseObservation> matches, const PnpOptions& options)
      : pinhole_(pinhole), matches_(matches), options_(options), random_(options.seed) {
    for (const PoseObservation& match : matches) {
      rays_.push_back(pinhole.Unproject(match.pixel).normalized());
      precision_.push_back(1.0 / (match.sigma_px * match.sigma_px));
    }
  }

  PnpSolution Run() {
    PnpSolution solution;
    P3PPoses poses;
    double needed = options_.max_iterations;
    while (solution.iterations < std::min<double>(options_.max_iterations, needed)) {
      ++solution.iterations;
      std::array<std::size_t, kSampleSize> sample;
      if (!Draw(solution.iterations, &sample)) continue;
      bool improved = false;
      const int count = Solve(sample, &poses);
      for (int k = 0; k < count; ++k) improved |= Consider(poses[static_cast<std::size_t>(k)]);
      if (improved) {
        Polish();
        needed = IterationsNeeded();
      }
    }
    if (best_inliers_ >= kSampleSize) Polish();
    solution.camera_from_map = best_;
    solution.num_inliers = best_inliers_;
    solution.found = best_inliers_ >= options_.min_inliers;
    const Transform best(best_);
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      solution.inlier.push_back(best_inliers_ > 0 && ChiSquare(best, i) <= options_.chi2_threshold ? 1 : 0);
    }
    return solution;
  }

 private:
  // A pose with its rotation as a matrix, which is what moves many points.
  struct Transform {
    explicit Transform(const SE3& pose) : rotation(pose.RotationMatrix()), translation(pose.translation()) {}
    Matrix3d rotation;
    Vector3d translation;
  };

  double ChiSquare(const Transform& pose, std::size_t i) const {
    const Vector3d point_c = pose.rotation * matches_[i].point + pose.translation;
    if (!optimization::InFront(point_c)) return 1e9;
    return optimization::ReprojectionResidual(pinhole_, point_c, matches_[i].pixel).squaredNorm() * precision_[i];
  }

  // False if the sample is degenerate: nearly collinear rays or points.
  bool Draw(int iteration, std::array<std::size_t, kSampleSize>* sample) {
    const auto pool = static_cast<std::uint64_t>(
        std::min<double>(static_cast<double>(matches_.size()), kFirstPool + kPoolGrowth * iteration));
    for (std::size_t i = 0; i < kSampleSize; ++i) {
      do {
        (*sample)[i] = random_.Below(pool);
      } while (std::find(sample->begin(), sample->begin() + i, (*sample)[i]) != sample->begin() + i);
    }
    const auto& [a, b, c] = *sample;
    const Vector2d u = matches_[b].pixel - matches_[a].pixel, v = matches_[c].pixel - matches_[a].pixel;
    const double area_px2 = std::abs(u.x() * v.y() - u.y() * v.x());
    const Vector3d p = matches_[b].point - matches_[a].point, q = matches_[c].point - matches_[a].point;
    return area_px2 > 200.0 && p.cross(q).squaredNorm() > 1e-8 * p.squaredNorm() * q.squaredNorm();
  }

  int Solve(const std::array<std::size_t, kSampleSize>& sample, P3PPoses* poses) const {
    P3PPoints points;
    P3PRays rays;
    for (std::size_t i = 0; i < kSampleSize; ++i) {
      points[i] = matches_[sample[i]].point;
      rays[i] = rays_[sample[i]];
    }
    return SolveP3P(rays, points, poses);
  }

  // Keeps the pose if its truncated error is the least so far.
  bool Consider(const SE3& pose) {
    double score = 0.0;
    int inliers = 0;
    double possible = options_.chi2_threshold * static_cast<double>(matches_.size());  // of all that are left
    const Transform transform(pose);
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      possible -= options_.chi2_threshold;
      const double chi2 = ChiSquare(transform, i);
      if (chi2 <= options_.chi2_threshold) {
        score += options_.chi2_threshold - chi2;
        ++inliers;
      } else if (score + possible <= best_score_) {
        return false;
      }
    }
    if (score <= best_score_) return false;
    best_score_ = score;
    best_inliers_ = inliers;
    best_ = pose;
    return true;
  }

  // Refines the best pose on its inliers.
  void Polish() {
    if (polished_ >= kLocalOptimizations || best_inliers_ < 5) return;
    ++polished_;
    std::vector<PoseObservation> inliers;
    const Transform best(best_);
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      // Somewhat farther ones too: a pose from three noisy points is not exact.
      if (ChiSquare(best, i) <= 2.0 * options_.chi2_threshold) inliers.push_back(matches_[i]);
    }
    optimization::PoseRefinementOptions refinement;
    refinement.rounds = 2;
    refinement.iterations_per_round = 5;
    refinement.chi2_threshold = options_.chi2_threshold;
    const auto refined = optimization::RefinePose(pinhole_, best_, inliers, refinement);
    if (refined.ok()) Consider(refined->camera_from_map);
  }

  double IterationsNeeded() const {
    const double share = static_cast<double>(best_inliers_) / static_cast<double>(matches_.size());
    const double good = std::pow(share, kSampleSize);
    if (good >= 1.0) return 1.0;
    return std::log(1.0 - options_.confidence) / std::log(1.0 - good);
  }

  const Pinhole& pinhole_;
  std::span<const PoseObservation> matches_;
  const PnpOptions& options_;
  Random random_;
  std::vector<Vector3d> rays_;     // unit
  std::vector<double> precision_;  // 1 / sigma_px^2
  SE3 best_;
  double best_score_ = 0.0;
  int best_inliers_ = 0;
  int polished_ = 0;
};

}  // namespace

absl::Status PnpOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("PnP: ", what)); };
  if (max_iterations < 1) return bad("max_iterations must be at least 1");
  if (!(confidence > 0.0 && confidence < 1.0)) return bad("confidence must be between 0 and 1");
  if (!(chi2_threshold > 0.0)) return bad("chi2_threshold must be positive");
  if (min_inliers < 4) return bad("min_inliers must be at least 4");
  return absl::OkStatus();
}

absl::StatusOr<PnpSolution> SolvePnpRansac(const Pinhole& pinhole, std::span<const PoseObservation> matches,
                                           const PnpOptions& options) {
  CAIRN_RETURN_IF_ERROR(options.Validate());
  if (matches.size() < static_cast<std::size_t>(options.min_inliers)) {
    PnpSolution none;
    none.inlier.assign(matches.size(), 0);
    return none;
  }
  return Ransac(pinhole, matches, options).Run();
}

}  // namespace cairn::tracking
