// How long the direct module's unit is in the map. Two measurements:
// - Sim(3) alignment of the latest keyframes' centres in both worlds (Lee and Civera, "Loosely-Coupled Semi-Direct
// Monocular SLAM",
//   RA-L 2019, Sec. V-A), of which only the scale is used. It needs translation and lags behind a scale that wanders.
// - The ratio of depths, in map and direct world, of the points that a single keyframe matches. It needs no motion and
// knows the
//   scale here and now; it needs matches.
// The estimate is the depth ratio, smoothed over a few keyframes, where there is a good one, else the alignment, else
// what it was: after a loss it stays frozen.
#pragma once

#include <deque>
#include <optional>
#include <span>

#include "base/status.h"
#include "geometry/se3.h"

namespace cairn::tracking {

struct RelativeScaleOptions {
  int min_window = 10;               // keyframes from which the alignment is used
  int max_window = 30;               // keyframes in it
  double max_alignment_sigma = 0.1;  // relative; a worse alignment is not used
  int min_ratios = 15;               // depth ratios of a keyframe to be used
  double max_ratio_sigma = 0.05;     // relative, of their median
  double ratio_memory = 0.5;         // weight of the past against a new ratio of the same quality, per keyframe

  absl::Status Validate() const;
};

struct ScaleMeasurement {
  double scale = 1.0;           // map units per direct unit
  double relative_sigma = 0.0;  // standard deviation of scale / scale
};

// Robust similarity of the centres. Nothing if there are too few, they do not move, or the answer is too uncertain.
std::optional<ScaleMeasurement> ScaleFromCentres(std::span<const Vector3d> map_centres,
                                                 std::span<const Vector3d> direct_centres,
                                                 const RelativeScaleOptions& options = {});

// Median of the ratios depth in map / depth in direct world, with its deviation from the median absolute deviation.
// Nothing if there are too few or they disagree.
std::optional<ScaleMeasurement> ScaleFromDepths(std::span<const double> ratios,
                                                const RelativeScaleOptions& options = {});

class RelativeScale {
 public:
  explicit RelativeScale(const RelativeScaleOptions& options = {}, double initial = 1.0)
      : options_(options), scale_(initial) {}

  double scale() const { return scale_; }
  double relative_sigma() const { return relative_sigma_; }  // 0: never measured
  bool known() const { return known_; }                      // false: scale() means nothing (yet)

  // One call per keyframe refined against the map, with whatever was measured there.
  void Update(const std::optional<ScaleMeasurement>& from_depths, const std::optional<ScaleMeasurement>& from_centres);
  // The map around here has grown by this factor; what was measured still holds.
  void Rescale(double factor) { scale_ *= factor; }
  // A new start, which says what the scale is: nothing of before counts.
  void Reset(double scale);
  // A new world on the direct side: nothing is known until it is measured.
  void Forget();

 private:
  RelativeScaleOptions options_;
  double scale_;
  double relative_sigma_ = 0.0;
  bool known_ = true;
};

}  // namespace cairn::tracking
