// Image files in memory: decoding to gray, and PNG to write. The formats are decoded by their own libraries (libpng,
// libjpeg, libtiff, libwebp; PGM, PPM and BMP here) and not by OpenCV's imgcodecs, whose dependencies (GDAL and all
// that it reads) cost every process that merely links it 40 MB and a tenth of a second.
#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::io {

// CV_8UC1 or, of files with 16 bits a channel, CV_16UC1. Colour becomes luma (ITU-R BT.601), alpha and rotations are
// ignored. The format is told by the first bytes. DataLoss: truncated, corrupt, or of no known format; InvalidArgument:
// whole, but with pixels of another kind. The message begins with a verb ("is truncated") and follows the file's name.
absl::StatusOr<cv::Mat> DecodeGray(absl::string_view bytes);

// Of CV_8UC1 or CV_16UC1; `compression` from 0 (none) to 9.
absl::StatusOr<std::string> EncodePng(const cv::Mat& gray, int compression);

}  // namespace cairn::io
