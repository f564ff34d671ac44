#include "image/orb_detection.h"

#include <algorithm>
#include <array>
#include <cmath>
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

}  // namespace

std::vector<Corner> DetectCorners(const cv::Mat& level, int threshold, int min_threshold) {
  // FAST looks 3 px around a pixel and one more for the comparison with the neighbours.
  constexpr int kMargin = kOrbBorderPx - 4;
  const cv::Rect inner(kMargin, kMargin, level.cols - 2 * kMargin, level.rows - 2 * kMargin);
  if (inner.width <= 8 || inner.height <= 8) return {};
  std::vector<cv::KeyPoint> found;
  // One pass at the lower threshold: OpenCV's response is the largest threshold at which a pixel is still a corner, so
  // the corners at the higher one are those with a response of at least that.
  cv::FAST(level(inner), found, min_threshold, true);

  const int columns = (level.cols + kCellPx - 1) / kCellPx;
  const int rows = (level.rows + kCellPx - 1) / kCellPx;
  std::vector<std::uint8_t> has_strong(static_cast<std::size_t>(columns) * rows, 0);
  std::vector<Corner> corners;
  corners.reserve(found.size());
  for (const cv::KeyPoint& point : found) {
    Corner corner;
    corner.x = static_cast<std::int16_t>(std::lround(point.pt.x) + kMargin);
    corner.y = static_cast<std::int16_t>(std::lround(point.pt.y) + kMargin);
    corner.score = static_cast<std::int16_t>(point.response);
    if (corner.x < kOrbBorderPx || corner.y < kOrbBorderPx || corner.x >= level.cols - kOrbBorderPx ||
        corner.y >= level.rows - kOrbBorderPx) {
      continue;
    }
    if (corner.score >= threshold) has_strong[(corner.y / kCellPx) * columns + corner.x / kCellPx] = 1;
    corners.push_back(corner);
  }
  std::erase_if(corners, [&](const Corner& corner) {
    return corner.score < threshold && has_strong[(corner.y / kCellPx) * columns + corner.x / kCellPx];
  });
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
  constexpr int kRadius = 3;
  static constexpr std::array<float, kRadius + 1> kWeight = {1.0f, 0.8007f, 0.4111f, 0.1353f};  // sigma 1.5 px
  float xx = 0.0f, xy = 0.0f, yy = 0.0f, bx = 0.0f, by = 0.0f;
  for (int v = -kRadius; v <= kRadius; ++v) {
    const std::uint8_t* above = level.ptr<std::uint8_t>(corner.y + v - 1) + corner.x;
    const std::uint8_t* here = level.ptr<std::uint8_t>(corner.y + v) + corner.x;
    const std::uint8_t* below = level.ptr<std::uint8_t>(corner.y + v + 1) + corner.x;
    for (int u = -kRadius; u <= kRadius; ++u) {
      const float gx = static_cast<float>(here[u + 1] - here[u - 1]);
      const float gy = static_cast<float>(below[u] - above[u]);
      const float weight = kWeight[std::abs(u)] * kWeight[std::abs(v)];
      xx += weight * gx * gx;
      xy += weight * gx * gy;
      yy += weight * gy * gy;
      const float along = weight * (gx * u + gy * v);
      bx += along * gx;
      by += along * gy;
    }
  }
  const cv::Point2f centre(corner.x, corner.y);
  const float determinant = xx * yy - xy * xy;
  const float trace = xx + yy;
  if (!(determinant > 0.02f * trace * trace)) return centre;
  const cv::Point2f offset((yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant);
  if (std::abs(offset.x) > 1.0f || std::abs(offset.y) > 1.0f) return centre;
  return centre + offset;
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
