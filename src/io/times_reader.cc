// A folder with times.txt, lines of `seconds filename`, and a camera.yaml.
#include "io/sequence_readers.h"

namespace cairn::io {

bool LooksLikeTimes(const std::filesystem::path& folder, const OpenOptions&) { return IsFile(folder / "times.txt"); }

absl::StatusOr<SequenceFiles> ReadTimes(const std::filesystem::path& folder, const OpenOptions& options) {
  SequenceFiles out;
  CAIRN_ASSIGN_OR_RETURN(const CameraFile file, GivenCamera(folder, options));
  out.camera = file.camera;
  out.rate_hz = file.rate_hz;
  CAIRN_RETURN_IF_ERROR(ReadTimedList(folder / "times.txt", &out));
  return out;
}

}  // namespace cairn::io
