// TUM RGB-D folders (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012): rgb.txt lists
// `seconds filename`. The depth images are not used; the camera comes from a camera.yaml.
#include "io/sequence_readers.h"

namespace cairn::io {

bool LooksLikeTumRgbd(const std::filesystem::path& folder, const OpenOptions&) { return IsFile(folder / "rgb.txt"); }

absl::StatusOr<SequenceFiles> ReadTumRgbd(const std::filesystem::path& folder, const OpenOptions& options) {
  SequenceFiles out;
  CAIRN_ASSIGN_OR_RETURN(const CameraFile file, GivenCamera(folder, options));
  out.camera = file.camera;
  out.rate_hz = file.rate_hz;
  CAIRN_RETURN_IF_ERROR(ReadTimedList(folder / "rgb.txt", &out));
  return out;
}

}  // namespace cairn::io
