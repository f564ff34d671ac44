#include "geometry/lens_correction.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cairn {

absl::Status LensCorrection::Validate() const {
  if (!(focal_scale > 0.0) || !std::isfinite(focal_scale) || !std::isfinite(k1) || !std::isfinite(k2)) {
    return absl::InvalidArgumentError(
        absl::StrCat("lens correction: focal_scale ", focal_scale, ", k1 ", k1, ", k2 ", k2, " is no lens"));
  }
  return absl::OkStatus();
}

Camera LensCorrection::CameraOf(const Pinhole& pinhole) const {
  Camera camera = Camera::FromPinhole(pinhole);
  camera.model = CameraModel::kRadialTangential;
  camera.fx_px *= focal_scale;
  camera.fy_px *= focal_scale;
  camera.distortion = {k1, k2, 0.0, 0.0};
  return camera;
}

std::optional<Eigen::Vector2d> LensCorrection::Ideal(const Pinhole& pinhole, const Eigen::Vector2d& pixel) const {
  const auto ray = CameraOf(pinhole).Unproject(pixel);
  if (!ray || !(ray->z() > 0.0)) return std::nullopt;
  return pinhole.Project(*ray);
}

LensCorrection::Shift LensCorrection::ShiftOver(const Pinhole& pinhole) const {
  constexpr int kSteps = 16;
  Shift shift;
  double sum = 0.0;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const Eigen::Vector2d pixel(i * (pinhole.width_px - 1.0) / kSteps, j * (pinhole.height_px - 1.0) / kSteps);
      const auto ideal = Ideal(pinhole, pixel);
      const double moved = ideal ? (*ideal - pixel).norm() : std::numeric_limits<double>::infinity();
      sum += moved * moved;
      shift.max_px = std::max(shift.max_px, moved);
    }
  }
  shift.rms_px = std::sqrt(sum / ((kSteps + 1) * (kSteps + 1)));
  return shift;
}

}  // namespace cairn
