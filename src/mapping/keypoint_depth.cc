#include "mapping/keypoint_depth.h"

#include <algorithm>
#include <cmath>

#include "image/matching.h"

namespace cairn::mapping {
namespace {

bool Usable(const direct::PacketPoint& point) {
  return std::isfinite(point.x_px) && std::isfinite(point.y_px) && std::isfinite(point.inverse_depth) &&
         std::isfinite(point.variance) && point.inverse_depth > 0.0f && point.variance > 0.0f;
}

// Nothing (unknown) if the points do not agree or are not good enough together.
KeypointDepth Mean(std::span<const direct::PacketPoint> points, std::span<const std::uint32_t> near,
                   const KeypointDepthOptions& options) {
  double weighted = 0.0, weights = 0.0;
  double low = points[near[0]].inverse_depth, high = low;
  for (const std::uint32_t i : near) {
    const double weight = 1.0 / points[i].variance;
    const double inverse_depth = points[i].inverse_depth;
    weighted += weight * inverse_depth;
    weights += weight;
    low = std::min(low, inverse_depth);
    high = std::max(high, inverse_depth);
  }
  const double mean = weighted / weights;
  const double variance = 1.0 / weights;
  if (high - low > options.max_relative_spread * mean) return {};
  if (variance > options.max_relative_sigma * options.max_relative_sigma * mean * mean) return {};
  return {mean, variance};
}

}  // namespace

absl::Status KeypointDepthOptions::Validate() const {
  if (!(radius_px > 0.0)) return absl::InvalidArgumentError("keypoint depth: radius_px must be positive");
  if (!(radius_growth >= 1.0)) return absl::InvalidArgumentError("keypoint depth: radius_growth must be at least 1");
  if (!(max_relative_sigma > 0.0)) {
    return absl::InvalidArgumentError("keypoint depth: max_relative_sigma must be positive");
  }
  if (!(max_relative_spread > 0.0)) {
    return absl::InvalidArgumentError("keypoint depth: max_relative_spread must be positive");
  }
  return absl::OkStatus();
}

std::vector<KeypointDepth> KeypointDepths(std::span<const image::Keypoint> keypoints,
                                          std::span<const direct::PacketPoint> points,
                                          const KeypointDepthOptions& options) {
  std::vector<KeypointDepth> depths(keypoints.size());
  // The grid is one over keypoint-like places; keep where each came from.
  std::vector<direct::PacketPoint> usable;
  std::vector<image::Keypoint> places;
  float width = 1.0f, height = 1.0f;
  for (const direct::PacketPoint& point : points) {
    if (!Usable(point)) continue;
    usable.push_back(point);
    places.push_back({point.x_px, point.y_px, 0.0f, 0});
    width = std::max(width, point.x_px + 1.0f);
    height = std::max(height, point.y_px + 1.0f);
  }
  if (usable.empty()) return depths;
  const image::FeatureGrid grid(places, static_cast<int>(std::ceil(width)), static_cast<int>(std::ceil(height)), 8);
  std::vector<std::uint32_t> near;
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    const double radius_px = options.radius_px * std::pow(options.radius_growth, keypoints[i].octave);
    grid.Query(keypoints[i].x_px, keypoints[i].y_px, static_cast<float>(radius_px), 0, 255, &near);
    if (!near.empty()) depths[i] = Mean(usable, near, options);
  }
  return depths;
}

}  // namespace cairn::mapping
