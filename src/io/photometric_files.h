// Photometric calibrations in the files of the TUM monoVO data set.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/status.h"
#include "base/time.h"
#include "image/photometric.h"

namespace cairn::io {

// `response_path`: pcalib.txt, 256 numbers, the inverse response; `vignette_path`: an 8-bit or 16-bit gray image.
// Either may be empty: none. Errors name the file.
absl::StatusOr<image::PhotometricCalibration> LoadPhotometricCalibration(const std::string& response_path,
                                                                         const std::string& vignette_path);

using Exposures = std::vector<std::pair<TimeNs, double>>;  // of an image of that time; in seconds or any other unit

struct PhotometricFolder {
  image::PhotometricCalibration calibration;
  // Of times.txt, in temporal order; nothing without that file. They belong to this calibration: without known exposure
  // times a response is determined only together with estimated ones.
  std::optional<Exposures> exposures;
};

// pcalib.txt, vignette.png (one of them at least) and times.txt (`id seconds exposure_ms`, if it is there) of a folder.
absl::StatusOr<PhotometricFolder> LoadPhotometricFolder(const std::string& folder);

// The names of the files in a folder that the next function writes.
std::vector<std::string> PhotometricFileNames();

// Writes these files; the folder must exist. `vignette`: CV_32FC1 in (0, 1]. `exposures`: none if empty, and a
// times.txt that is there goes. AlreadyExists if any of the files is there and not `overwrite`.
absl::Status SavePhotometricFolder(const std::string& folder, const std::array<double, 256>& inverse_response,
                                   const cv::Mat& vignette, const Exposures& exposures, bool overwrite);

}  // namespace cairn::io
