#include "map/viewing.h"

namespace cairn::map {

Viewing ComputeViewing(const Vector3d& position, std::span<const Vector3d> camera_centers,
                       const Vector3d& reference_center, int reference_octave, double reference_focal_px,
                       const image::OrbParameters& orb) {
  Vector3d direction = Vector3d::Zero();
  for (const Vector3d& center : camera_centers) direction += (position - center).normalized();
  const double distance = (position - reference_center).norm();

  Viewing viewing;
  viewing.mean_direction = direction.normalized().cast<float>();
  viewing.pixel_size = static_cast<float>(distance * orb.Scale(reference_octave) / reference_focal_px);
  return viewing;
}

}  // namespace cairn::map
