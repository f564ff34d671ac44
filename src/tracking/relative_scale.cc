#include "tracking/relative_scale.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/median.h"
#include "geometry/alignment.h"

namespace cairn::tracking {
absl::Status RelativeScaleOptions::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("relative scale: ", what)); };
  if (min_window < 4 || max_window < min_window) return bad("windows must satisfy 4 <= min_window <= max_window");
  if (!(max_alignment_sigma > 0.0)) return bad("max_alignment_sigma must be positive");
  if (min_ratios < 3) return bad("min_ratios must be at least 3");
  if (!(max_ratio_sigma > 0.0)) return bad("max_ratio_sigma must be positive");
  if (!(ratio_memory >= 0.0 && ratio_memory < 1.0)) return bad("ratio_memory must be in [0, 1)");
  return absl::OkStatus();
}

std::optional<ScaleMeasurement> ScaleFromCentres(std::span<const Vector3d> map_centres,
                                                 std::span<const Vector3d> direct_centres,
                                                 const RelativeScaleOptions& options) {
  const std::size_t count = std::min(map_centres.size(), direct_centres.size());
  if (static_cast<int>(count) < options.min_window) return std::nullopt;
  const std::size_t used = std::min(count, static_cast<std::size_t>(options.max_window));
  RobustAlignmentOptions alignment_options;
  alignment_options.alignment.allow_collinear = true;  // a straight path still has a length
  const auto alignment = AlignPointsRobust(map_centres.last(used), direct_centres.last(used), alignment_options);
  if (!alignment.ok() || !(alignment->a_from_b.scale() > 0.0)) return std::nullopt;
  const ScaleMeasurement measured{alignment->a_from_b.scale(), alignment->scale_sigma / alignment->a_from_b.scale()};
  if (!std::isfinite(measured.relative_sigma) || measured.relative_sigma > options.max_alignment_sigma) {
    return std::nullopt;
  }
  return measured;
}

std::optional<ScaleMeasurement> ScaleFromDepths(std::span<const double> ratios, const RelativeScaleOptions& options) {
  std::vector<double> logs;
  for (const double ratio : ratios) {
    if (ratio > 0.0 && std::isfinite(ratio)) logs.push_back(std::log(ratio));
  }
  if (static_cast<int>(logs.size()) < options.min_ratios) return std::nullopt;
  const double median = Median(logs);
  for (double& value : logs) value = std::abs(value - median);
  // 1.4826 MAD is the deviation of a normal distribution; that of a median is 1.2533 / sqrt(n) of it.
  const double sigma = 1.2533 * 1.4826 * Median(logs) / std::sqrt(static_cast<double>(logs.size()));
  if (sigma > options.max_ratio_sigma) return std::nullopt;
  return ScaleMeasurement{std::exp(median), sigma};
}

void RelativeScale::Update(const std::optional<ScaleMeasurement>& from_depths,
                           const std::optional<ScaleMeasurement>& from_centres) {
  const auto& measured = from_depths ? from_depths : from_centres;
  if (!measured) return;
  known_ = true;
  if (!from_depths || relative_sigma_ == 0.0) {
    scale_ = measured->scale;
    relative_sigma_ = std::max(measured->relative_sigma, 1e-6);
    return;
  }
  const double past = options_.ratio_memory;
  scale_ = std::exp(past * std::log(scale_) + (1.0 - past) * std::log(measured->scale));
  relative_sigma_ = std::sqrt(past * relative_sigma_ * relative_sigma_ +
                              (1.0 - past) * measured->relative_sigma * measured->relative_sigma);
}

void RelativeScale::Reset(double scale) {
  scale_ = scale;
  relative_sigma_ = 0.0;
  known_ = true;
}

void RelativeScale::Forget() {
  relative_sigma_ = 0.0;
  known_ = false;
}

}  // namespace cairn::tracking
