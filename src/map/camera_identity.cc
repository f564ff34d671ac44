#include "map/camera_identity.h"

#include <algorithm>
#include <cmath>

namespace cairn::map {
namespace {

constexpr double kSamePx = 0.1;

}  // namespace

bool SamePinhole(const Pinhole& a, const Pinhole& b) {
  return a.width_px == b.width_px && a.height_px == b.height_px && std::abs(a.fx_px - b.fx_px) < kSamePx &&
         std::abs(a.fy_px - b.fy_px) < kSamePx && std::abs(a.cx_px - b.cx_px) < kSamePx &&
         std::abs(a.cy_px - b.cy_px) < kSamePx;
}

bool SameCalibration(const Camera& a, const Camera& b) {
  if (a == b) return true;
  if (a.width_px != b.width_px || a.height_px != b.height_px) return false;
  constexpr int kSteps = 8;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const Eigen::Vector2d pixel(i * (a.width_px - 1.0) / kSteps, j * (a.height_px - 1.0) / kSteps);
      const std::optional<Eigen::Vector3d> ray = a.Unproject(pixel);
      if (!ray) continue;
      const std::optional<Eigen::Vector2d> other = b.Project(*ray);
      if (!other || (*other - pixel).norm() > kSamePx) return false;
    }
  }
  return true;
}

bool SameLens(const Camera& a, const Camera& b) {
  if (SameCalibration(a, b)) return true;
  const double x = static_cast<double>(b.width_px) / a.width_px, y = static_cast<double>(b.height_px) / a.height_px;
  // Whole pixels of the smaller one.
  if (std::abs(x - y) * std::min(a.height_px, b.height_px) > std::max(x, y)) return false;
  Camera resized = a;
  resized.width_px = b.width_px;
  resized.height_px = b.height_px;
  resized.fx_px *= x;
  resized.fy_px *= y;
  resized.cx_px = x * (a.cx_px + 0.5) - 0.5;
  resized.cy_px = y * (a.cy_px + 0.5) - 0.5;
  if (std::abs(resized.cx_px - b.cx_px) > std::max(1.0, x) || std::abs(resized.cy_px - b.cy_px) > std::max(1.0, y)) {
    return false;
  }
  resized.cx_px = b.cx_px;
  resized.cy_px = b.cy_px;
  return SameCalibration(resized, b);
}

}  // namespace cairn::map
