#include "tracking/calibration_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <utility>

#include "base/median.h"
#include "optimization/focal_estimate.h"

namespace cairn::tracking {
namespace {

using optimization::PoseObservation;

// Each is within a seventh of what lies between it and the next, from where the estimate converges.
constexpr std::array kFactors = {0.37, 0.45, 0.57, 0.74, 0.87, 1.15, 1.35, 1.75, 2.2, 2.7};
constexpr double kNearChi2 = 400.0;  // of a start: what is nearer may be drawn in
constexpr double kMostLogFocal = 1.2;
constexpr int kIterationsPerFocal = 150;
// Every start is followed for so many rounds, and those with most inliers then to the end: as sure as
// following all of them, but for 4 of 184 images by 22 calibrations, and none silent (docs/benchmarks.md).
constexpr int kFirstRounds = 1, kRounds = 3;
constexpr std::size_t kFollowed = 3;

double ChiSquare(const Pinhole& pinhole, const SE3& camera_from_map, const PoseObservation& match) {
  const Vector3d point_c = camera_from_map * match.point;
  if (!optimization::InFront(point_c)) return 1e9;
  return optimization::ReprojectionResidual(pinhole, point_c, match.pixel).squaredNorm() /
         (match.sigma_px * match.sigma_px);
}

Pinhole Scaled(const Pinhole& pinhole, double factor) {
  Pinhole scaled = pinhole;
  scaled.fx_px *= factor;
  scaled.fy_px *= factor;
  return scaled;
}

struct Start {
  Pinhole pinhole;
  SE3 camera_from_map;
  optimization::FocalPrior prior;
};

// The calibration and the pose in which they agree near this start.
std::optional<OtherCalibration> Converge(const Start& start, std::span<const PoseObservation> matches, int rounds) {
  std::vector<PoseObservation> near;
  for (const PoseObservation& match : matches) {
    if (ChiSquare(start.pinhole, start.camera_from_map, match) <= kNearChi2) near.push_back(match);
  }
  optimization::PoseRefinementOptions options;
  options.rounds = rounds;
  options.iterations_per_round = 4;
  const auto estimate = optimization::EstimateFocal(start.pinhole, start.camera_from_map, near, options, start.prior);
  if (!estimate.ok()) return std::nullopt;
  OtherCalibration other;
  other.pinhole = estimate->Corrected(start.pinhole);
  other.camera_from_map = estimate->camera_from_map;
  other.num_inliers = CountInliers(other.pinhole, other.camera_from_map, matches, &other.inlier);
  return other;
}

void KeepBetter(const Pinhole& pinhole, std::optional<OtherCalibration> other, std::optional<OtherCalibration>* best) {
  if (!other || std::abs(std::log(other->pinhole.fx_px / pinhole.fx_px)) > kMostLogFocal) return;
  if (!*best || other->num_inliers > (*best)->num_inliers) *best = std::move(other);
}

}  // namespace

int CountInliers(const Pinhole& pinhole, const SE3& camera_from_map, std::span<const PoseObservation> matches,
                 std::vector<std::uint8_t>* inlier) {
  int count = 0;
  if (inlier != nullptr) inlier->clear();
  for (const PoseObservation& match : matches) {
    const bool agrees = ChiSquare(pinhole, camera_from_map, match) <= PnpOptions().chi2_threshold;
    count += agrees ? 1 : 0;
    if (inlier != nullptr) inlier->push_back(agrees ? 1 : 0);
  }
  return count;
}

std::optional<OtherCalibration> SearchCalibration(const Pinhole& pinhole, const SE3& camera_from_map,
                                                  std::span<const PoseObservation> matches) {
  std::vector<double> depths;
  for (const PoseObservation& match : matches) {
    if (ChiSquare(pinhole, camera_from_map, match) <= kNearChi2) depths.push_back((camera_from_map * match.point).z());
  }
  if (depths.empty()) return std::nullopt;
  const double depth = Median(std::move(depths));
  std::vector<Start> starts = {{pinhole, camera_from_map, {}},
                               {pinhole, camera_from_map, optimization::FocalPrior::WithPrincipalPoint()}};
  for (const double factor : kFactors) {
    // As far away as makes what is at that depth look as large.
    const SE3 moved(camera_from_map.rotation(),
                    camera_from_map.translation() + Vector3d(0.0, 0.0, (factor - 1.0) * depth));
    starts.push_back({Scaled(pinhole, factor), moved, {}});
  }
  std::vector<std::pair<int, const Start*>> tried;
  for (const Start& start : starts) {
    const auto other = Converge(start, matches, kFirstRounds);
    if (other) tried.emplace_back(other->num_inliers, &start);
  }
  std::ranges::stable_sort(tried, std::ranges::greater(), &std::pair<int, const Start*>::first);
  std::optional<OtherCalibration> best;
  for (std::size_t i = 0; i < std::min(kFollowed, tried.size()); ++i) {
    KeepBetter(pinhole, Converge(*tried[i].second, matches, kRounds), &best);
  }
  return best;
}

std::optional<OtherCalibration> SearchCalibration(const Pinhole& pinhole, std::span<const PoseObservation> matches,
                                                  const PnpOptions& options) {
  PnpOptions pnp = options;
  pnp.max_iterations = std::min(pnp.max_iterations, kIterationsPerFocal);
  std::optional<OtherCalibration> best;
  for (const double factor : kFactors) {
    const Pinhole scaled = Scaled(pinhole, factor);
    const auto solution = SolvePnpRansac(scaled, matches, pnp);
    if (!solution.ok() || !solution->found) continue;
    OtherCalibration other{scaled, solution->camera_from_map, solution->inlier, solution->num_inliers};
    KeepBetter(pinhole, std::move(other), &best);
  }
  if (best) KeepBetter(pinhole, Converge({best->pinhole, best->camera_from_map, {}}, matches, kRounds), &best);
  return best;
}

bool ManyMore(int with_another, int as_calibrated) {
  constexpr int kLeast = 8;
  constexpr double kShare = 0.15;
  return with_another >= as_calibrated + std::max<double>(kLeast, kShare * as_calibrated);
}

}  // namespace cairn::tracking
