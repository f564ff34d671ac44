#include "client/anchor.h"

#include <algorithm>
#include <cmath>

#include "tracking/map_bend.h"

namespace cairn::client {
namespace {

constexpr double kManyInliers = 150.0;
constexpr double kLearn = 0.1;  // weight of a match in Drift
constexpr double kMostSurprise = 9.0;
constexpr double kLeastDrift = 0.5, kMostDrift = 4.0;
constexpr double kBlendSigmas = 4.0;  // a match further from what was carried on stands alone

double Square(double x) { return x * x; }

}  // namespace

absl::Status DriftOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("tracker: ", what)); };
  if (!(way_share >= 0.0 && turn_share >= 0.0)) return bad("way_share and turn_share must not be negative");
  if (!(depth_share > 0.0 && rotation_rad > 0.0)) return bad("depth_share and rotation_rad must be positive");
  if (!(match_noise > 0.0)) return bad("match_noise must be positive");
  if (!(blind_factor >= 1.0)) return bad("blind_factor must be at least 1");
  return map.Validate();
}

void Odometer::Add(const SE3& motion, double factor) {
  way += factor * motion.translation().norm();
  turn_rad += factor * AngleRad(motion.rotation());
}

double Drift::factor() const { return std::sqrt(variance_); }

void Drift::Learn(double surprise) {
  variance_ += kLearn * variance_ * (std::min(surprise, kMostSurprise) - 1.0);
  variance_ = std::clamp(variance_, kLeastDrift * kLeastDrift, kMostDrift * kMostDrift);
}

MotionSigma SigmaSince(const Anchor& anchor, const Odometer& now, const DriftOptions& options, double drift) {
  const double way = now.way - anchor.odometer.way, turn_rad = now.turn_rad - anchor.odometer.turn_rad;
  return {drift * std::hypot(options.way_share * way, options.depth_share * anchor.place.median_depth),
          drift * std::hypot(options.turn_share * turn_rad, options.rotation_rad)};
}

double MatchVariance(int inliers, const DriftOptions& options) {
  return Square(options.match_noise) * std::max(1.0, kManyInliers / std::max(inliers, 1));
}

double Blend(const Anchor& before, const SE3& carried, const MotionSigma& motion, Anchor* match) {
  const double depth = match->place.median_depth;
  if (!(depth > 0.0)) return 1.0;
  const double carried_variance =
      before.noise_variance + Square(motion.translation / depth) + Square(motion.rotation_rad);
  const Vector6d apart = (carried.Inverse() * match->place.map_from_camera).Log();
  const double apart2 = (apart.head<3>() / depth).squaredNorm() + apart.tail<3>().squaredNorm();
  const double surprise = apart2 / (3.0 * (carried_variance + match->noise_variance));  // three axes
  if (surprise > Square(kBlendSigmas)) return surprise;
  const double gain = carried_variance / (carried_variance + match->noise_variance);
  match->place.map_from_camera = carried * SE3::Exp(gain * apart);
  match->noise_variance *= gain;
  return surprise;
}

Matrix6d CovarianceOf(const Anchor& anchor, const SE3& map_from_camera, const MotionSigma& motion,
                      const DriftOptions& options) {
  const tracking::MapError map = tracking::Larger(
      tracking::MapErrorOf({anchor.inliers, anchor.residual_rms, anchor.place.median_depth}, options.map),
      anchor.place.bend);
  // A left increment of the anchor's pose is one of every pose that hangs on it.
  return anchor.covariance + tracking::CovarianceAtCamera(map_from_camera,
                                                          std::hypot(motion.translation, map.translation),
                                                          std::hypot(motion.rotation_rad, map.rotation_rad));
}

}  // namespace cairn::client
