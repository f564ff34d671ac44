#include "image/matching.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/cpu_features.h"
#include "image/hamming.h"

namespace cairn::image {
namespace {

constexpr std::size_t kBlock = 256;

// Of several matches to the same b, only the nearest stays (the first of equals).
std::vector<FeatureMatch> KeepNearestOfEachB(std::vector<FeatureMatch> matches, std::size_t size_b) {
  std::vector<std::uint32_t> best(size_b, kNoFeature);
  for (std::uint32_t i = 0; i < matches.size(); ++i) {
    std::uint32_t& current = best[matches[i].b];
    if (current == kNoFeature || matches[i].distance < matches[current].distance) current = i;
  }
  std::vector<FeatureMatch> kept;
  kept.reserve(matches.size());
  for (std::uint32_t i = 0; i < matches.size(); ++i) {
    if (best[matches[i].b] == i) kept.push_back(matches[i]);
  }
  return kept;
}

}  // namespace

absl::Status MatchOptions::Validate() const {
  if (max_distance < 0 || max_distance > 256) {
    return absl::InvalidArgumentError(
        absl::StrCat("matching max_distance is ", max_distance, " bits; it must be between 0 and 256"));
  }
  if (!(max_ratio > 0.0 && max_ratio <= 1.0)) {
    return absl::InvalidArgumentError(
        absl::StrCat("matching max_ratio is ", max_ratio, "; it must be above 0 and at most 1"));
  }
  return absl::OkStatus();
}

BestTwo FindBestTwo(const Descriptor& query, std::span<const Descriptor> descriptors,
                    std::span<const std::uint32_t> candidates) {
  BestTwo best;
  std::array<std::uint16_t, kBlock> distances;
  for (std::size_t begin = 0; begin < candidates.size(); begin += kBlock) {
    const std::size_t count = std::min(kBlock, candidates.size() - begin);
    HammingDistancesAt(query, descriptors.data(), candidates.data() + begin, count, distances.data());
    for (std::size_t i = 0; i < count; ++i) best.Add(candidates[begin + i], distances[i]);
  }
  return best;
}

BestTwo FindBestTwo(const Descriptor& query, std::span<const Descriptor> descriptors) {
  BestTwo best;
  std::array<std::uint16_t, kBlock> distances;
  for (std::size_t begin = 0; begin < descriptors.size(); begin += kBlock) {
    const std::size_t count = std::min(kBlock, descriptors.size() - begin);
    HammingDistances(query, descriptors.data() + begin, count, distances.data());
    for (std::size_t i = 0; i < count; ++i) best.Add(static_cast<std::uint32_t>(begin + i), distances[i]);
  }
  return best;
}

std::vector<FeatureMatch> MatchBruteForce(const Features& a, const Features& b, const MatchOptions& options) {
  std::vector<FeatureMatch> matches;
  if (a.descriptors.empty() || b.descriptors.empty()) return matches;
  // The nearest of a for every b falls out of the same distances.
  std::vector<std::uint16_t> nearest_distance(b.size(), 257);
  std::vector<std::uint32_t> nearest(b.size(), kNoFeature);
  std::vector<std::uint16_t> distances(b.size());
  for (std::uint32_t i = 0; i < a.size(); ++i) {
    HammingDistances(a.descriptors[i], b.descriptors.data(), b.size(), distances.data());
    BestTwo best;
    for (std::uint32_t j = 0; j < b.size(); ++j) {
      best.Add(j, distances[j]);
      if (distances[j] < nearest_distance[j]) {
        nearest_distance[j] = distances[j];
        nearest[j] = i;
      }
    }
    if (best.Accept(options.max_distance, options.max_ratio)) matches.push_back({i, best.index, best.distance});
  }
  if (options.mutual) {
    std::erase_if(matches, [&](const FeatureMatch& match) { return nearest[match.b] != match.a; });
  }
  if (options.check_rotation) matches = KeepConsistentRotations(a.keypoints, b.keypoints, std::move(matches));
  return matches;
}

std::vector<FeatureMatch> KeepConsistentRotations(std::span<const Keypoint> a, std::span<const Keypoint> b,
                                                  std::vector<FeatureMatch> matches, int bins, int keep_bins) {
  if (matches.empty() || bins < 4 || keep_bins < 1) return matches;
  constexpr float kTurn = 2.0f * std::numbers::pi_v<float>;
  const auto bin_of = [&](const FeatureMatch& match) {
    const float turn = (a[match.a].angle_rad - b[match.b].angle_rad) / kTurn;
    const int bin = static_cast<int>((turn - std::floor(turn)) * static_cast<float>(bins));
    return bin % bins;
  };
  std::vector<int> count(bins, 0);
  for (const FeatureMatch& match : matches) ++count[bin_of(match)];
  std::vector<int> order(bins);
  for (int i = 0; i < bins; ++i) order[i] = i;
  std::sort(order.begin(), order.end(),
            [&](int p, int q) { return count[p] != count[q] ? count[p] > count[q] : p < q; });
  std::vector<bool> keep(bins, false);
  for (int i = 0; i < std::min(keep_bins, bins); ++i) {
    const int bin = order[i];
    if (10 * count[bin] < count[order[0]]) break;
    keep[(bin + bins - 1) % bins] = keep[bin] = keep[(bin + 1) % bins] = true;
  }
  std::erase_if(matches, [&](const FeatureMatch& match) { return !keep[bin_of(match)]; });
  return matches;
}

FeatureGrid::FeatureGrid(std::span<const Keypoint> keypoints, int width_px, int height_px, int cell_px) {
  const int cell = std::max(cell_px, 1);
  columns_ = std::max((width_px + cell - 1) / cell, 1);
  rows_ = std::max((height_px + cell - 1) / cell, 1);
  inverse_cell_ = 1.0 / cell;
  const auto cell_of = [&](const Keypoint& keypoint) {
    const int column = std::clamp(static_cast<int>(std::floor(keypoint.x_px * inverse_cell_)), 0, columns_ - 1);
    const int row = std::clamp(static_cast<int>(std::floor(keypoint.y_px * inverse_cell_)), 0, rows_ - 1);
    return static_cast<std::size_t>(row) * columns_ + column;
  };
  cell_begin_.assign(static_cast<std::size_t>(columns_) * rows_ + 1, 0);
  for (const Keypoint& keypoint : keypoints) ++cell_begin_[cell_of(keypoint) + 1];
  for (std::size_t i = 1; i < cell_begin_.size(); ++i) cell_begin_[i] += cell_begin_[i - 1];
  std::vector<std::uint32_t> next(cell_begin_.begin(), cell_begin_.end() - 1);
  entries_.resize(keypoints.size());
  for (std::uint32_t i = 0; i < keypoints.size(); ++i) {
    entries_[next[cell_of(keypoints[i])]++] = {keypoints[i].x_px, keypoints[i].y_px, i, keypoints[i].octave};
  }
}

void FeatureGrid::Query(double x_px, double y_px, double radius_px, int min_octave, int max_octave,
                        std::vector<std::uint32_t>* out) const {
  QuerySegment(x_px, y_px, x_px, y_px, radius_px, min_octave, max_octave, out);
}

std::vector<std::uint32_t> FeatureGrid::Query(double x_px, double y_px, double radius_px, int min_octave,
                                              int max_octave) const {
  std::vector<std::uint32_t> out;
  Query(x_px, y_px, radius_px, min_octave, max_octave, &out);
  return out;
}

void FeatureGrid::QuerySegment(double begin_x_px, double begin_y_px, double end_x_px, double end_y_px,
                               double half_width_px, int min_octave, int max_octave,
                               std::vector<std::uint32_t>* out) const {
  out->clear();
  const double dx = end_x_px - begin_x_px, dy = end_y_px - begin_y_px;
  const double length_squared = dx * dx + dy * dy;
  if (entries_.empty() || !(half_width_px >= 0.0) || !std::isfinite(length_squared)) return;
  const double inverse_squared = length_squared > 1e-18 ? 1.0 / length_squared : 0.0;
  const int low_octave = std::max(min_octave, 0);
  if (max_octave < low_octave) return;
  const internal::SegmentQuery query = {begin_x_px,
                                        begin_y_px,
                                        dx,
                                        dy,
                                        inverse_squared,
                                        half_width_px * half_width_px,
                                        static_cast<std::uint32_t>(low_octave),
                                        static_cast<std::uint32_t>(max_octave - low_octave)};
  static const internal::SegmentKernel near_segment =
      ActiveSimdLevel() == SimdLevel::kBaseline ? &internal::NearSegmentPortable : &internal::NearSegmentAvx2;
  std::size_t kept = 0;
  const auto cell = [&](double position_px, int count) {
    return static_cast<int>(std::clamp(position_px * inverse_cell_, 0.0, count - 1.0));
  };
  const int first_row = cell(std::min(begin_y_px, end_y_px) - half_width_px, rows_);
  const int last_row = cell(std::max(begin_y_px, end_y_px) + half_width_px, rows_);
  for (int row = first_row; row <= last_row; ++row) {
    // The part of the segment that comes near this row of cells; the border rows reach to infinity, as their cells do.
    double from = 0.0, to = 1.0;
    if (std::abs(dy) > 1e-9) {
      const double top = row == 0 ? -std::numeric_limits<double>::infinity() : row / inverse_cell_;
      const double bottom = row == rows_ - 1 ? std::numeric_limits<double>::infinity() : (row + 1) / inverse_cell_;
      const double a = (top - half_width_px - begin_y_px) / dy, b = (bottom + half_width_px - begin_y_px) / dy;
      from = std::max(from, std::min(a, b));
      to = std::min(to, std::max(a, b));
      if (from > to) continue;
    }
    const double x_a = begin_x_px + from * dx, x_b = begin_x_px + to * dx;
    const int first_column = cell(std::min(x_a, x_b) - half_width_px, columns_);
    const int last_column = cell(std::max(x_a, x_b) + half_width_px, columns_);
    const std::size_t base = static_cast<std::size_t>(row) * columns_;
    const std::uint32_t begin = cell_begin_[base + first_column], end = cell_begin_[base + last_column + 1];
    if (out->size() < kept + (end - begin) + internal::kSegmentSlack) {
      out->resize(kept + (end - begin) + internal::kSegmentSlack);
    }
    kept += near_segment(entries_.data() + begin, end - begin, query, out->data() + kept);
  }
  out->resize(kept);
}

std::vector<FeatureMatch> MatchInWindows(const Features& a, std::span<const FeatureWindow> windows, const Features& b,
                                         const FeatureGrid& grid_b, const MatchOptions& options) {
  std::vector<FeatureMatch> matches;
  std::vector<std::uint32_t> candidates;
  for (const FeatureWindow& window : windows) {
    grid_b.Query(window.x_px, window.y_px, window.radius_px, window.min_octave, window.max_octave, &candidates);
    const BestTwo best = FindBestTwo(a.descriptors[window.feature], b.descriptors, candidates);
    if (best.Accept(options.max_distance, options.max_ratio)) {
      matches.push_back({window.feature, best.index, best.distance});
    }
  }
  if (options.mutual) matches = KeepNearestOfEachB(std::move(matches), b.size());
  if (options.check_rotation) matches = KeepConsistentRotations(a.keypoints, b.keypoints, std::move(matches));
  return matches;
}

}  // namespace cairn::image
