#include <cstring>
#include <exception>
#include <opencv2/imgcodecs.hpp>

#include "absl/strings/match.h"
#include "io/atomic_file.h"
#include "io/frame_source.h"

namespace cairn::io {
namespace {

// Decoders fill up a truncated JPEG with gray and call it a success. A whole one has its end marker behind the start of
// the coded data, in which that pair of bytes cannot occur (ITU T.81, Annex B).
bool IsTruncatedJpeg(absl::string_view bytes) {
  if (!absl::StartsWith(bytes, "\xFF\xD8")) return false;
  std::size_t at = 2;
  while (at + 4 <= bytes.size()) {
    const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(bytes[i]); };
    if (byte(at) != 0xFF) return false;  // not a segment: leave it to the decoder
    if (byte(at + 1) == 0xFF) {
      ++at;  // fill byte
      continue;
    }
    if (byte(at + 1) == 0xDA) return bytes.find("\xFF\xD9", at) == absl::string_view::npos;
    at += 2 + static_cast<std::size_t>(byte(at + 2) << 8 | byte(at + 3));
  }
  return true;
}

absl::Status Unreadable(const std::string& path, absl::string_view why) {
  return absl::DataLossError(absl::StrCat(path, " is ", why));
}

}  // namespace

absl::StatusOr<cv::Mat> ReadGrayImage(const std::string& path, cv::Size expected) {
  CAIRN_ASSIGN_OR_RETURN(const std::string bytes, ReadWholeFile(path));
  if (bytes.empty()) return Unreadable(path, "empty");
  if (IsTruncatedJpeg(bytes)) return Unreadable(path, "truncated");
  cv::Mat image;
  try {
    const cv::Mat buffer(1, static_cast<int>(bytes.size()), CV_8UC1, const_cast<char*>(bytes.data()));
    image = cv::imdecode(buffer, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
    if (image.depth() == CV_16U) image.convertTo(image, CV_8U, 1.0 / 257.0);
  } catch (const std::exception&) {
    image.release();
  }
  if (image.empty()) return Unreadable(path, "not a whole image of a known format");
  if (image.type() != CV_8UC1)
    return absl::InvalidArgumentError(absl::StrCat(path, " has neither 8 nor 16 bits a pixel"));
  if (!expected.empty() && image.size() != expected) {
    return absl::InvalidArgumentError(absl::StrCat(path, " has ", image.cols, "x", image.rows,
                                                   " px but the calibration is for ", expected.width, "x",
                                                   expected.height, " px; give the camera file of this size"));
  }
  return image;
}

}  // namespace cairn::io
