// A session's map tells what the calibration of its camera left over: bundle adjustment with an unknown lens
// (optimization/lens_adjustment.h), taken only where the observations leave no doubt.
#pragma once

#include <optional>
#include <span>
#include <string>

#include "base/status.h"
#include "geometry/lens_correction.h"
#include "map/edit.h"
#include "optimization/lens_adjustment.h"

namespace cairn::mapping {

struct LensRefinementOptions {
  bool enabled = true;
  // Chi-square that the lens must explain (three degrees of freedom; 16 would be significant if errors were
  // independent, which those of neighbouring features are not).
  double min_gain = 60.0;
  // What is further from the calibration than so many standard deviations of the prior (LensAdjustmentOptions), or
  // moves pixels by more than this share of the image's diagonal, is no remainder but another camera.
  double max_sigmas = 3.0;
  double max_shift_share = 0.03;

  absl::Status Validate() const;
};

struct LensReport {
  bool applied = false;
  bool another_camera = false;  // too far from the calibration for a remainder of it
  LensCorrection lens;
  LensCorrection::Shift shift;  // by which it moves pixels
  double gain = 0.0;            // see LensResult
  std::string reason;           // for people
};

// What an adjustment has found of a camera, against what may be left of its calibration.
LensReport JudgeLens(const optimization::LensResult& result, const Pinhole& pinhole,
                     const LensRefinementOptions& options);

// `keyframes`, all of `camera`, have just been adjusted. If a lens is found, the camera, keypoints, poses and points in
// `edit` become those that fit it. Nothing if there is too little to tell, or the camera has a correction already.
absl::StatusOr<std::optional<LensReport>> RefineLens(map::Edit& edit, std::span<const KeyframeId> keyframes,
                                                     CameraId camera, const LensRefinementOptions& options);

}  // namespace cairn::mapping
