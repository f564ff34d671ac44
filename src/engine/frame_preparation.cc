#include "engine/frame_preparation.h"

#include <utility>

#include "base/guarded.h"

namespace cairn::engine {

absl::StatusOr<FramePreparation> FramePreparation::Create(const SessionSource& source) {
  CAIRN_RETURN_IF_ERROR(source.camera.Validate());
  CAIRN_ASSIGN_OR_RETURN(image::Undistorter undistorter, image::Undistorter::Create(source.camera));
  if (source.photometric) CAIRN_RETURN_IF_ERROR(source.photometric->ValidateFor(source.camera));
  return FramePreparation(std::move(undistorter), source.photometric);
}

absl::StatusOr<direct::Frame> FramePreparation::Prepare(const RawFrame& raw) const {
  CAIRN_ASSIGN_OR_RETURN(image::PreparedImage prepared, Guarded([&] {
                           return image::PrepareImage(raw.gray, undistorter_, photometric_ ? &*photometric_ : nullptr);
                         }));
  direct::Frame frame;
  frame.index = raw.index;
  frame.time_ns = raw.time_ns;
  frame.image = std::move(prepared.gray);
  frame.corrected = std::move(prepared.corrected);
  if (photometric_) frame.exposure_gain = photometric_->ExposureGain(raw.exposure_s);
  return frame;
}

}  // namespace cairn::engine
