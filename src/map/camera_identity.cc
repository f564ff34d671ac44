#include "map/camera_identity.h"

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

}  // namespace cairn::map
