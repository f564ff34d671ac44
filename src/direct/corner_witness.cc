#include "direct/corner_witness.h"

#include "direct/start_confirmation.h"

namespace cairn::direct {

CornerWitness::CornerWitness(const OdometryOptions& options, const Pinhole& camera, const Frame& reference,
                             double noise_px)
    : corners_(options, camera), noise_px2_(noise_px * noise_px) {
  corners_.Add(reference);
}

bool CornerWitness::BearsOut(const Frame& frame, const SE3& camera_from_reference) {
  if (corners_.FrameCount() == 0 || !corners_.Continue(frame)) return false;  // no corners, or too few are left
  camera_from_reference_.emplace_back(camera_from_reference);
  // Of the corners that fit: what moves by itself has corners of its own.
  const double rms_px = corners_.InlierRmsPxOf(camera_from_reference_);
  return rms_px > 0.0 && !ExplainsClearlyWorse(rms_px * rms_px, noise_px2_);
}

}  // namespace cairn::direct
