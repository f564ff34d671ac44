#include "geometry/pose_alignment_start.h"

#include <algorithm>
#include <limits>

#include "base/median.h"
#include "base/random.h"
#include "geometry/alignment.h"

namespace cairn {
namespace {

// Indices of at most `most` of n, evenly spaced.
std::vector<std::size_t> Some(std::size_t n, std::size_t most) {
  std::vector<std::size_t> indices;
  const std::size_t count = std::min(n, most);
  for (std::size_t k = 0; k < count; ++k) indices.push_back(k * n / count);
  return indices;
}

Vector3d Centroid(std::span<const SE3> poses) {
  Vector3d sum = Vector3d::Zero();
  for (const SE3& pose : poses) sum += pose.translation();
  return sum / static_cast<double>(poses.size());
}

std::vector<SE3> Subset(std::span<const SE3> poses, const std::vector<std::size_t>& indices) {
  std::vector<SE3> some;
  for (const std::size_t i : indices) some.push_back(poses[i]);
  return some;
}

constexpr std::size_t kMostPairs = 1000;

}  // namespace

Quaterniond VotedRotation(std::span<const Quaterniond> rotations) {
  constexpr std::size_t kMostCandidates = 100;
  const std::vector<std::size_t> voters = Some(rotations.size(), kMostPairs);
  Quaterniond best = Quaterniond::Identity();
  double best_rad = std::numeric_limits<double>::infinity();
  for (const std::size_t i : Some(rotations.size(), kMostCandidates)) {
    std::vector<double> angles;
    for (const std::size_t j : voters) angles.push_back(rotations[i].angularDistance(rotations[j]));
    const double median_rad = Median(std::move(angles));
    if (median_rad < best_rad) {
      best_rad = median_rad;
      best = rotations[i];
    }
  }
  constexpr double kNear = 2.0;
  Vector3d mean_rad = Vector3d::Zero();
  int count = 0;
  for (const std::size_t j : voters) {
    if (best.angularDistance(rotations[j]) > kNear * best_rad + 1e-9) continue;
    mean_rad += LogSO3(rotations[j] * best.conjugate());
    ++count;
  }
  return count > 0 ? (ExpSO3(mean_rad / count) * best).normalized() : best;
}

PoseAlignmentState StartFromOrientations(std::span<const SE3> poses_a, std::span<const SE3> poses_b,
                                         const Quaterniond& camera_from_body,
                                         const PoseAlignmentStartOptions& options) {
  std::vector<Quaterniond> votes;
  for (std::size_t i = 0; i < poses_a.size(); ++i) {
    votes.push_back(poses_a[i].rotation() * (poses_b[i].rotation() * camera_from_body).conjugate());
  }
  PoseAlignmentState state;
  state.camera_from_body = camera_from_body;
  state.rotation = VotedRotation(votes);
  state.center_b = Centroid(poses_b);
  state.center_a = Centroid(poses_a);

  const std::vector<std::size_t> pairs = Some(poses_a.size(), kMostPairs);
  std::vector<Vector3d> a, b;
  for (const std::size_t i : pairs) {
    a.push_back(poses_a[i].translation());
    b.push_back(state.rotation * (poses_b[i].translation() - state.center_b));
  }
  double spread_a = 0.0, spread_b = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    spread_a += (a[i] - state.center_a).squaredNorm();
    spread_b += b[i].squaredNorm();
  }
  if (options.with_scale && spread_b > 0.0) state.scale = std::max(1e-12, std::sqrt(spread_a / spread_b));
  Random random(options.seed);
  double best = std::numeric_limits<double>::infinity();
  for (int k = 0; k < options.max_samples; ++k) {
    const std::size_t i = random.Below(a.size()), j = random.Below(a.size());
    const Vector3d along = b[j] - b[i];
    if (i == j || along.squaredNorm() == 0.0) continue;
    const double scale = options.with_scale ? (a[j] - a[i]).dot(along) / along.squaredNorm() : 1.0;
    if (scale <= 0.0) continue;
    const Vector3d center = 0.5 * (a[i] + a[j] - scale * (b[i] + b[j]));
    std::vector<double> residuals;
    residuals.reserve(a.size());
    for (std::size_t m = 0; m < a.size(); ++m) residuals.push_back((a[m] - center - scale * b[m]).norm());
    const double median = Median(std::move(residuals));
    if (median >= best) continue;
    best = median;
    state.scale = scale;
    state.center_a = center;
  }
  return state;
}

absl::StatusOr<PoseAlignmentState> StartFromPositions(std::span<const SE3> poses_a, std::span<const SE3> poses_b,
                                                      bool with_mount, const PoseAlignmentStartOptions& options) {
  const std::vector<std::size_t> pairs = Some(poses_a.size(), kMostPairs);
  const std::vector<SE3> some_a = Subset(poses_a, pairs), some_b = Subset(poses_b, pairs);
  std::vector<Vector3d> a, b;
  for (const SE3& pose : some_a) a.push_back(pose.translation());
  for (const SE3& pose : some_b) b.push_back(pose.translation());
  RobustAlignmentOptions robust;
  robust.alignment.with_scale = options.with_scale;
  robust.alignment.allow_collinear = true;
  robust.max_samples = options.max_samples;
  robust.seed = options.seed;
  CAIRN_ASSIGN_OR_RETURN(const Alignment points, AlignPointsRobust(a, b, robust));
  PoseAlignmentState state;
  state.center_b = Centroid(poses_b);
  state.center_a = points.a_from_b * state.center_b;
  state.rotation = points.a_from_b.rotation();
  state.scale = points.a_from_b.scale();
  if (with_mount) {
    std::vector<Quaterniond> votes;
    for (std::size_t i = 0; i < some_a.size(); ++i) {
      votes.push_back((state.rotation * some_b[i].rotation()).conjugate() * some_a[i].rotation());
    }
    state.camera_from_body = VotedRotation(votes);
  }
  return state;
}

}  // namespace cairn
