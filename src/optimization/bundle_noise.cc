#include "optimization/bundle_noise.h"

#include <algorithm>
#include <cmath>

#include "base/median.h"

namespace cairn::optimization {
namespace {

constexpr int kMinSights = 4;                  // of a point whose residuals count
constexpr std::size_t kMinSamples = 50;        // residuals that tell the noise of pixels
constexpr std::size_t kMinDifferences = 8;     // differences that tell that of rotations
constexpr double kMedianOfTwoAxes = 1.1774;    // median length of a vector of 2 normal numbers ...
constexpr double kMedianOfThreeAxes = 1.5382;  // ... and of 3
constexpr std::size_t kLongestWay = 16;

}  // namespace

double PixelNoise(const BundleProblem& problem, std::span<const std::uint8_t> used, std::span<const double> chi2) {
  std::vector<int> sights(problem.points.size(), 0);
  for (std::size_t i = 0; i < used.size(); ++i) sights[problem.observations[i].point] += used[i] ? 1 : 0;
  std::vector<double> squares;
  for (std::size_t i = 0; i < used.size(); ++i) {
    if (used[i] && sights[problem.observations[i].point] >= kMinSights) squares.push_back(chi2[i]);
  }
  return squares.size() < kMinSamples ? 0.0 : std::sqrt(Median(squares)) / kMedianOfTwoAxes;
}

double RotationNoise(const BundleProblem& problem, std::span<const SE3> poses) {
  const std::vector<BundleRotation>& all = problem.rotations;
  double most = 0.0;
  for (std::size_t way = 1; way <= kLongestWay; way *= 2) {
    std::vector<double> differences;
    for (std::size_t first = 0; first + way <= all.size(); ++first) {
      Quaterniond measured = all[first].b_from_a;
      double steps = all[first].steps;
      bool chained = true;
      for (std::size_t i = first + 1; chained && i < first + way; ++i) {
        chained = all[i].pose_a == all[i - 1].pose_b;
        measured = all[i].b_from_a * measured;
        steps += all[i].steps;
      }
      if (!chained) continue;
      const Quaterniond b_from_a =
          poses[all[first + way - 1].pose_b].rotation() * poses[all[first].pose_a].rotation().conjugate();
      differences.push_back(LogSO3(b_from_a * measured.conjugate()).norm() / std::sqrt(steps));
    }
    // One wrong rotation is part of so many of them as the way is long: it must not be in half of them.
    if (differences.size() < kMinDifferences || differences.size() <= 2 * way) break;
    most = std::max(most, Median(differences) / kMedianOfThreeAxes);
  }
  return most;
}

}  // namespace cairn::optimization
