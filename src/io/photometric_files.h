// Reads photometric calibrations as in the TUM monoVO data set.
#pragma once

#include <string>

#include "base/status.h"
#include "image/photometric.h"

namespace cairn::io {

// `response_path`: pcalib.txt, 256 numbers, the inverse response; `vignette_path`: an 8-bit or 16-bit gray image.
// Either may be empty: none. Errors name the file.
absl::StatusOr<image::PhotometricCalibration> LoadPhotometricCalibration(const std::string& response_path,
                                                                         const std::string& vignette_path);

}  // namespace cairn::io
