// What the map itself errs where an image was matched against it: no number of matches takes that away.
//
// Per axis, in proportion to the depth of the scene, times the cube of how badly the matches fit, and more where few
// points are seen: where a map is bent, or its lens or shutter not what the model says, images fit it worse, and at its
// edge it knows few points, and those from few sides. A measured law, not a derived one: in rendered worlds residuals
// are half as large as in a recording of a handheld camera with a rolling shutter, and the errors a fifth
// (docs/benchmarks.md).
#pragma once

#include "base/status.h"
#include "geometry/se3.h"

namespace cairn::tracking {

struct MapErrorOptions {
  double depth_share = 0.0096;   // of the median depth, where residual_rms is 1
  double rotation_rad = 0.0077;  // likewise

  absl::Status Validate() const;
};

// How an image fits the map.
struct MapFit {
  int inliers = 0;
  double residual_rms = 1.0;  // of the inliers, whitened, per coordinate
  double median_depth = 0.0;  // of the inliers, map units
};

// Standard deviations per axis.
struct MapError {
  double translation = 0.0;  // map units
  double rotation_rad = 0.0;
};
MapError MapErrorOf(const MapFit& fit, const MapErrorOptions& options = {});

// The covariance of (translation, rotation) as a left increment of `map_from_camera`, of errors that are independent
// per axis of the camera.
Matrix6d CovarianceAtCamera(const SE3& map_from_camera, double translation_sigma, double rotation_sigma_rad);

}  // namespace cairn::tracking
