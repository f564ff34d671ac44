// Brightness of a frame against the scene, after DSO Sec. 2.1 and 2.2: I = g e^a (scene) + b with the known factor g of
// the exposure time and an affine remainder (a, b), and what is known about that remainder.
// Of a calibrated image with known exposure only what the calibration gets wrong is left for them: both are drawn to 0.
// Else they stand for what is not known and are free.
#pragma once

#include <cmath>

#include "direct/packet.h"

namespace cairn::direct {

struct AffineLight {
  double a = 0.0;
  double b = 0.0;
};

// Information of (a, b) against 0.
struct LightPrior {
  double a = 0.0;
  double b = 0.0;

  double Energy(const AffineLight& light) const { return a * light.a * light.a + b * light.b * light.b; }
};

// `a_sigma`, `b_sigma_gray`: against a noise of one gray level in a single residual; 0: no prior.
inline LightPrior PriorOf(const Frame& frame, double a_sigma, double b_sigma_gray) {
  LightPrior prior;
  if (frame.corrected.empty() || !(frame.exposure_gain > 0.0)) return prior;
  if (a_sigma > 0.0) prior.a = 1.0 / (a_sigma * a_sigma);
  if (b_sigma_gray > 0.0) prior.b = 1.0 / (b_sigma_gray * b_sigma_gray);
  return prior;
}

// From the host's to the target's exposure; 1 unless both are known.
inline double ExposureRatio(double target_gain, double host_gain) {
  return target_gain > 0.0 && host_gain > 0.0 ? target_gain / host_gain : 1.0;
}

}  // namespace cairn::direct
