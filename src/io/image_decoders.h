// One function per format behind DecodeGray(); results and errors as there.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "absl/strings/string_view.h"
#include "base/status.h"

namespace cairn::io {

absl::StatusOr<cv::Mat> DecodePng(absl::string_view bytes);
absl::StatusOr<cv::Mat> DecodeJpeg(absl::string_view bytes);
absl::StatusOr<cv::Mat> DecodeTiff(absl::string_view bytes);
absl::StatusOr<cv::Mat> DecodeWebp(absl::string_view bytes);
absl::StatusOr<cv::Mat> DecodeBmp(absl::string_view bytes);
absl::StatusOr<cv::Mat> DecodePnm(absl::string_view bytes);  // P2, P3, P5, P6

// DataLoss if no image is as large as the file claims.
absl::StatusOr<cv::Mat> NewImage(std::int64_t width, std::int64_t height, int type);

inline absl::Status NotWhole() { return absl::DataLossError("is not a whole image"); }
inline absl::Status Truncated() { return absl::DataLossError("is truncated"); }

// ITU-R BT.601, in 14 bits; exact for gray, for up to 16 bits a channel.
inline std::uint32_t Luma(std::uint32_t red, std::uint32_t green, std::uint32_t blue) {
  return (4899 * red + 9617 * green + 1868 * blue + 8192) >> 14;
}

}  // namespace cairn::io
