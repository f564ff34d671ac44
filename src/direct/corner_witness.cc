#include "direct/corner_witness.h"

#include "direct/start_confirmation.h"

namespace cairn::direct {

CornerWitness::CornerWitness(const OdometryOptions& options, const Pinhole& camera, const Frame& reference,
                             double noise_px)
    : corners_(options, camera), noise_px2_(noise_px * noise_px), last_(reference) {
  FollowFromLast();
}

void CornerWitness::FollowFromLast() {
  corners_.Reset();
  corners_.Add(last_);
  first_from_reference_ = last_from_reference_;
  camera_from_first_ = {SE3()};
}

bool CornerWitness::Follows(const Frame& frame) { return corners_.FrameCount() > 0 && corners_.Continue(frame); }

bool CornerWitness::BearsOut(const Frame& frame, const SE3& camera_from_reference) {
  if (!Follows(frame)) {  // what passes through the view takes corners along, and so does a long way
    FollowFromLast();
    if (!Follows(frame)) return false;
  }
  camera_from_first_.emplace_back(camera_from_reference * first_from_reference_.Inverse());
  last_ = frame;
  last_from_reference_ = camera_from_reference;
  // Of the corners that fit: what moves by itself has corners of its own.
  const double rms_px = corners_.InlierRmsPxOf(camera_from_first_);
  return rms_px > 0.0 && !ExplainsClearlyWorse(rms_px * rms_px, noise_px2_);
}

}  // namespace cairn::direct
