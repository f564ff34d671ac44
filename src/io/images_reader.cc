// A plain folder of images (or its subfolder images/) with a camera.yaml that says rate_hz: image i in the order of
// their numbers is taken at i / rate_hz seconds.
#include <cmath>

#include "io/image_series.h"
#include "io/sequence_readers.h"

namespace cairn::io {

namespace fs = std::filesystem;

bool LooksLikeImages(const fs::path& folder, const OpenOptions&) {
  return !ImageNamesIn(folder).empty() || !ImageNamesIn(folder / "images").empty();
}

absl::StatusOr<SequenceFiles> ReadImages(const fs::path& folder, const OpenOptions& options) {
  const fs::path where = ImageNamesIn(folder).empty() ? folder / "images" : folder;
  if (ImageNamesIn(where).empty()) {
    return absl::NotFoundError(
        absl::StrCat("no image files (png, jpg, bmp, pgm, ppm, tif, webp) in ", folder.string(), " or its images/"));
  }
  CAIRN_ASSIGN_OR_RETURN(const CameraFile file, GivenCamera(folder, options));
  if (file.rate_hz <= 0.0) {
    return absl::InvalidArgumentError(
        absl::StrCat("the images in ", where.string(), " have no times; add `rate_hz: 30`, say, to the camera file"));
  }
  SequenceFiles out;
  CAIRN_ASSIGN_OR_RETURN(ImageSeries series, FindImageSeries(where, {file.camera.width_px, file.camera.height_px}));
  const std::vector<std::string>& names = series.names;
  out.notes = std::move(series.notes);
  out.camera = file.camera;
  out.rate_hz = file.rate_hz;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const TimeNs time_ns = static_cast<TimeNs>(std::llround(static_cast<double>(i) * 1e9 / file.rate_hz));
    out.images.push_back({time_ns, (where / names[i]).string(), 0.0});
  }
  return out;
}

}  // namespace cairn::io
