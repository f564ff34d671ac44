#include "engine/frame_preparation.h"

#include <utility>

#include "base/guarded.h"

namespace cairn::engine {

absl::StatusOr<FramePreparation> FramePreparation::Create(const SessionSource& source) {
  CAIRN_RETURN_IF_ERROR(source.camera.Validate());
  FramePreparation preparation;
  CAIRN_ASSIGN_OR_RETURN(preparation.undistorter_, image::Undistorter::Create(source.camera));
  if (source.photometric) CAIRN_RETURN_IF_ERROR(source.photometric->ValidateFor(source.camera));
  preparation.photometric_ = source.photometric;
  return preparation;
}

absl::StatusOr<FramePreparation> FramePreparation::Untouched(const Camera& camera) {
  CAIRN_RETURN_IF_ERROR(camera.Validate());
  FramePreparation preparation;
  preparation.untouched_ = camera.Intrinsics();
  return preparation;
}

absl::StatusOr<direct::Frame> FramePreparation::Prepare(const RawFrame& raw) const {
  direct::Frame frame;
  frame.index = raw.index;
  frame.time_ns = raw.time_ns;
  if (!undistorter_) {
    if (raw.gray.cols != untouched_.width_px || raw.gray.rows != untouched_.height_px) {
      return absl::InvalidArgumentError(absl::StrCat("the image has ", raw.gray.cols, "x", raw.gray.rows,
                                                     " pixels, its camera ", untouched_.width_px, "x",
                                                     untouched_.height_px));
    }
    frame.image = raw.gray;
    return frame;
  }
  CAIRN_ASSIGN_OR_RETURN(image::PreparedImage prepared, Guarded([&] {
                           return image::PrepareImage(raw.gray, *undistorter_, photometric_ ? &*photometric_ : nullptr);
                         }));
  frame.image = std::move(prepared.gray);
  frame.corrected = std::move(prepared.corrected);
  if (photometric_) frame.exposure_gain = photometric_->ExposureGain(raw.exposure_s);
  return frame;
}

}  // namespace cairn::engine
