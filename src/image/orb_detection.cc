#include "image/orb_detection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <opencv2/features2d.hpp>

namespace cairn::image::internal {
namespace {

constexpr int kCellPx = 32;
constexpr int kPatchSize = 2 * kOrbPatchRadiusPx + 1;

// Weights of the moments over a disc; rows padded to 32 columns with zeros.
struct MomentWeights {
  alignas(64) std::array<std::array<std::int16_t, 32>, kPatchSize> x{};
  alignas(64) std::array<std::array<std::int16_t, 32>, kPatchSize> y{};
};

MomentWeights MakeMomentWeights() {
  MomentWeights weights;
  for (int v = -kOrbPatchRadiusPx; v <= kOrbPatchRadiusPx; ++v) {
    const int half = static_cast<int>(std::lround(std::sqrt(kOrbPatchRadiusPx * kOrbPatchRadiusPx - v * v)));
    for (int u = -half; u <= half; ++u) {
      weights.x[v + kOrbPatchRadiusPx][u + kOrbPatchRadiusPx] = static_cast<std::int16_t>(u);
      weights.y[v + kOrbPatchRadiusPx][u + kOrbPatchRadiusPx] = static_cast<std::int16_t>(v);
    }
  }
  return weights;
}

// How many corners survive when each suppresses a square of half side `radius` around it. Cells of half that size hold
// the suppressed area; `kept`, if given, receives the survivors.
int CountSpread(const std::vector<Corner>& corners, double radius, cv::Size size, int stop_at,
                std::vector<std::uint8_t>* covered, std::vector<Corner>* kept) {
  const double cell = radius / 2.0;
  const int columns = static_cast<int>(size.width / cell) + 1;
  const int rows = static_cast<int>(size.height / cell) + 1;
  const double inverse = 1.0 / cell;
  constexpr int kReach = 2;
  const int stride = columns + 2 * kReach;  // a rim, so that squares need no clipping
  covered->assign(static_cast<std::size_t>(stride) * (rows + 2 * kReach), 0);
  int count = 0;
  for (const Corner& corner : corners) {
    const int column = static_cast<int>(corner.x * inverse);
    const int row = static_cast<int>(corner.y * inverse);
    std::uint8_t* top_left = covered->data() + static_cast<std::size_t>(row) * stride + column;
    if (top_left[kReach * stride + kReach]) continue;
    for (int r = 0; r <= 2 * kReach; ++r) std::fill_n(top_left + r * stride, 2 * kReach + 1, 1);
    if (kept) kept->push_back(corner);
    if (++count >= stop_at) break;
  }
  return count;
}

// The least contrast along the best arc of 9 of the 16 pixels around (x, y): one above the largest FAST threshold at
// which it is a corner; negative contrasts tell how far from one it is.
int CornerScore(const cv::Mat& level, int x, int y) {
  // The circle of radius 3 in order.
  static constexpr std::array<int, 16> kX = {0, 1, 2, 3, 3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1};
  static constexpr std::array<int, 16> kY = {3, 3, 2, 1, 0, -1, -2, -3, -3, -3, -2, -1, 0, 1, 2, 3};
  const std::uint8_t* centre = level.ptr<std::uint8_t>(y) + x;
  const auto stride = static_cast<std::ptrdiff_t>(level.step[0]);
  // Least and largest difference over arcs of 1, 2, 4, 8 and at last 9, each array long enough for the next.
  std::array<std::int16_t, 32> low;
  for (int i = 0; i < 16; ++i) {
    low[i] = static_cast<std::int16_t>(centre[0] - centre[kY[i] * stride + kX[i]]);
    low[i + 16] = low[i];
  }
  std::array<std::int16_t, 32> high = low;
  const std::array<std::int16_t, 32> difference = low;
  for (const int step : {1, 2, 4}) {
    for (int i = 0; i < 24; ++i) {
      low[i] = std::min(low[i], low[i + step]);
      high[i] = std::max(high[i], high[i + step]);
    }
  }
  int best = -255;
  for (int i = 0; i < 16; ++i) {
    const int darker = std::min(low[i], difference[i + 8]);
    const int brighter = -std::max(high[i], difference[i + 8]);
    best = std::max(best, std::max(darker, brighter));
  }
  return best;
}

// Appends the corners inside `area`, maxima among their neighbours inside or outside of it.
void DetectInside(const cv::Mat& level, const cv::Rect& area, int threshold, std::vector<cv::KeyPoint>* buffer,
                  std::vector<Corner>* corners) {
  if (area.empty()) return;
  // FAST looks 3 px around a pixel, and one more for the comparison with the neighbours.
  constexpr int kMargin = 4;
  const cv::Rect seen(area.x - kMargin, area.y - kMargin, area.width + 2 * kMargin, area.height + 2 * kMargin);
  cv::FAST(level(seen), *buffer, threshold, true);
  for (const cv::KeyPoint& point : *buffer) {
    const cv::Point position(static_cast<int>(std::lround(point.pt.x)) + seen.x,
                             static_cast<int>(std::lround(point.pt.y)) + seen.y);
    if (!area.contains(position)) continue;
    corners->push_back({static_cast<std::int16_t>(position.x), static_cast<std::int16_t>(position.y),
                        static_cast<std::int16_t>(point.response)});
  }
}

}  // namespace

std::vector<Corner> DetectCorners(const cv::Mat& level, int threshold, int min_threshold) {
  const cv::Rect inner(kOrbBorderPx, kOrbBorderPx, level.cols - 2 * kOrbBorderPx, level.rows - 2 * kOrbBorderPx);
  if (inner.width <= 0 || inner.height <= 0) return {};
  std::vector<cv::KeyPoint> buffer;
  std::vector<Corner> corners;
  DetectInside(level, inner, threshold, &buffer, &corners);

  const int columns = (level.cols + kCellPx - 1) / kCellPx;
  const int rows = (level.rows + kCellPx - 1) / kCellPx;
  std::vector<std::uint8_t> has_corner(static_cast<std::size_t>(columns) * rows, 0);
  for (const Corner& corner : corners) has_corner[(corner.y / kCellPx) * columns + corner.x / kCellPx] = 1;
  // Neighbouring empty cells of a row together.
  for (int row = 0; row < rows; ++row) {
    const std::uint8_t* cells = &has_corner[static_cast<std::size_t>(row) * columns];
    for (int begin = 0; begin < columns;) {
      int end = begin;
      while (end < columns && !cells[end]) ++end;
      const cv::Rect strip(begin * kCellPx, row * kCellPx, (end - begin) * kCellPx, kCellPx);
      if (end > begin) DetectInside(level, strip & inner, min_threshold, &buffer, &corners);
      begin = end + 1;
    }
  }
  return corners;
}

std::vector<Corner> SpreadCorners(std::vector<Corner> corners, int count, cv::Size size) {
  if (count <= 0) return {};
  std::sort(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) {
    if (a.score != b.score) return a.score > b.score;
    if (a.y != b.y) return a.y < b.y;
    return a.x < b.x;
  });
  if (static_cast<int>(corners.size()) <= count) return corners;

  // Squares of half side 1 suppress nothing but neighbours; squares that tile the image `count` times leave fewer.
  double low = 1.0;
  double high = 2.0 + 2.0 * std::sqrt(static_cast<double>(size.area()) / count);
  std::vector<std::uint8_t> covered;
  for (int i = 0; i < 12 && high - low > 0.05 * low; ++i) {
    const double middle = 0.5 * (low + high);
    if (CountSpread(corners, middle, size, count, &covered, nullptr) >= count) {
      low = middle;
    } else {
      high = middle;
    }
  }
  std::vector<Corner> kept;
  kept.reserve(count);
  CountSpread(corners, low, size, count, &covered, &kept);
  return kept;
}

cv::Point2f RefineCorner(const cv::Mat& level, const Corner& corner) {
  const int centre = CornerScore(level, corner.x, corner.y);
  const auto offset = [centre](int before, int after) {
    const int curvature = before - 2 * centre + after;
    if (curvature >= 0) return 0.0f;
    return std::clamp(0.5f * static_cast<float>(before - after) / static_cast<float>(curvature), -0.5f, 0.5f);
  };
  return {static_cast<float>(corner.x) +
              offset(CornerScore(level, corner.x - 1, corner.y), CornerScore(level, corner.x + 1, corner.y)),
          static_cast<float>(corner.y) +
              offset(CornerScore(level, corner.x, corner.y - 1), CornerScore(level, corner.x, corner.y + 1))};
}

float Orientation(const cv::Mat& level, const Corner& corner) {
  static const MomentWeights weights = MakeMomentWeights();
  int moment_x = 0;
  int moment_y = 0;
  for (int v = 0; v < kPatchSize; ++v) {
    // The 32nd pixel has no weight but is inside the image (kOrbBorderPx).
    const std::uint8_t* row = level.ptr<std::uint8_t>(corner.y - kOrbPatchRadiusPx + v) + corner.x - kOrbPatchRadiusPx;
    for (int u = 0; u < 32; ++u) {
      const auto value = static_cast<std::int16_t>(row[u]);
      moment_x += weights.x[v][u] * value;
      moment_y += weights.y[v][u] * value;
    }
  }
  const float angle_rad = std::atan2(static_cast<float>(moment_y), static_cast<float>(moment_x));
  return angle_rad >= std::numbers::pi_v<float> ? -std::numbers::pi_v<float> : angle_rad;
}

}  // namespace cairn::image::internal
