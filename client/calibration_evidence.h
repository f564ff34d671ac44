// What all images of a stream say of the camera's calibration together: one image alone can err by what the map is bent
// there, and says little where it sees few points or a flat scene.
#pragma once

#include "client/map_matcher.h"
#include "geometry/se3.h"
#include "optimization/focal_estimate.h"

namespace cairn::client {

class CalibrationEvidence {
 public:
  // Of an image that was matched; nothing happens if that says nothing of the calibration.
  void Add(const Sighting& sighting);

  // What the focal length should be multiplied by, where enough images contradict the calibration; 1: they do not.
  double focal_factor() const;

  // The covariance of a sighting's pose, covering what is known of the calibration by now.
  Matrix6d Cover(const Sighting& sighting) const;

 private:
  // Logarithm of the focal length's factor, and the shift of the principal point: means weighted by what each image
  // leaves open.
  struct Mean {
    double precision = 0.0;
    double weighted = 0.0;

    // `usual`: what an image errs by beside what its matches leave open.
    void Add(double value, double sigma, double usual);
    double value() const { return precision > 0.0 ? weighted / precision : 0.0; }
    double sigma() const;
  };
  optimization::FocalEstimate Together() const;

  int images_ = 0;
  Mean log_focal_, shift_x_, shift_y_;
};

}  // namespace cairn::client
