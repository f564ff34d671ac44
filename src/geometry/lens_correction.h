// What a camera's calibration left over: undistorted images that are not quite those of their pinhole. A session finds
// it out from its own map (optimization/lens_adjustment.h); keypoints are then moved to where the pinhole sees them, so
// that everything else works with the pinhole as before.
#pragma once

#include <optional>

#include "base/status.h"
#include "geometry/camera.h"

namespace cairn {

// Relative to a pinhole with focal lengths fx, fy and centre c: the point seen at (x, y, 1) really appears at
// c + focal_scale (1 + k1 r^2 + k2 r^4) (fx x, fy y), r^2 = x^2 + y^2 (Brown, "Decentering distortion of lenses",
// 1966).
struct LensCorrection {
  double focal_scale = 1.0;
  double k1 = 0.0;
  double k2 = 0.0;

  bool operator==(const LensCorrection&) const = default;

  // InvalidArgument for a scale that is not positive or numbers that are not finite.
  absl::Status Validate() const;

  // The camera that the undistorted images really come from.
  Camera CameraOf(const Pinhole& pinhole) const;

  // Where the pinhole would have seen what appears at `pixel`; nothing where the polynomial has turned back.
  std::optional<Eigen::Vector2d> Ideal(const Pinhole& pinhole, const Eigen::Vector2d& pixel) const;

  // By how much pixels move, over a grid of the image: root mean square and greatest. Infinite where there is no
  // answer.
  struct Shift {
    double rms_px = 0.0;
    double max_px = 0.0;
  };
  Shift ShiftOver(const Pinhole& pinhole) const;
};

}  // namespace cairn
