#include "io/atomic_file.h"
#include "io/frame_source.h"
#include "io/image_codecs.h"
#include "io/intensity_range.h"

namespace cairn::io {

absl::StatusOr<cv::Mat> ReadDeepImage(const std::string& path, cv::Size expected) {
  CAIRN_ASSIGN_OR_RETURN(const std::string bytes, ReadWholeFile(path));
  absl::StatusOr<cv::Mat> decoded = DecodeGray(bytes);
  if (!decoded.ok()) {
    return absl::Status(decoded.status().code(), absl::StrCat(path, " ", decoded.status().message()));
  }
  cv::Mat image = *std::move(decoded);
  if (!expected.empty() && image.size() != expected) {
    return absl::InvalidArgumentError(absl::StrCat(path, " has ", image.cols, "x", image.rows,
                                                   " px but the calibration is for ", expected.width, "x",
                                                   expected.height, " px; give the camera file of this size"));
  }
  return image;
}

absl::StatusOr<cv::Mat> ReadGrayImage(const std::string& path, cv::Size expected) {
  CAIRN_ASSIGN_OR_RETURN(cv::Mat image, ReadDeepImage(path, expected));
  if (image.depth() == CV_16U) {
    IntensityStatistics statistics;
    statistics.Add(image);
    ToEightBits(statistics.Range(), &image);
  }
  return image;
}

}  // namespace cairn::io
