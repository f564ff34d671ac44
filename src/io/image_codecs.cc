#include "io/image_codecs.h"

#include <webp/decode.h>

#include "absl/strings/match.h"
#include "io/image_decoders.h"

namespace cairn::io {

absl::StatusOr<cv::Mat> NewImage(std::int64_t width, std::int64_t height, int type) {
  constexpr std::int64_t kMaxSide = 1 << 16, kMaxPixels = 100'000'000;  // as of a camera
  if (width < 1 || height < 1 || width > kMaxSide || height > kMaxSide || width * height > kMaxPixels) {
    return absl::DataLossError(absl::StrCat("claims to have ", width, "x", height, " px"));
  }
  return cv::Mat(static_cast<int>(height), static_cast<int>(width), type);
}

absl::StatusOr<cv::Mat> DecodeWebp(absl::string_view bytes) {
  const auto* data = reinterpret_cast<const std::uint8_t*>(bytes.data());
  int width = 0, height = 0;
  if (WebPGetInfo(data, bytes.size(), &width, &height) == 0) return NotWhole();
  CAIRN_ASSIGN_OR_RETURN(const cv::Mat color, NewImage(width, height, CV_8UC3));
  if (WebPDecodeRGBInto(data, bytes.size(), color.data, color.total() * 3, static_cast<int>(color.step[0])) ==
      nullptr) {
    return NotWhole();
  }
  CAIRN_ASSIGN_OR_RETURN(cv::Mat gray, NewImage(width, height, CV_8UC1));
  for (int y = 0; y < height; ++y) {
    const auto* in = color.ptr<std::uint8_t>(y);
    auto* out = gray.ptr<std::uint8_t>(y);
    for (int x = 0; x < width; ++x, in += 3) out[x] = static_cast<std::uint8_t>(Luma(in[0], in[1], in[2]));
  }
  return gray;
}

absl::StatusOr<cv::Mat> DecodeGray(absl::string_view bytes) {
  if (bytes.empty()) return absl::DataLossError("is empty");
  if (absl::StartsWith(bytes, "\x89PNG\r\n\x1a\n")) return DecodePng(bytes);
  if (absl::StartsWith(bytes, "\xFF\xD8")) return DecodeJpeg(bytes);
  for (const absl::string_view tiff : {"II*", "II+"}) {
    if (absl::StartsWith(bytes, tiff)) return DecodeTiff(bytes);
  }
  for (const char version : {'*', '+'}) {
    if (bytes.size() >= 4 && absl::StartsWith(bytes, "MM") && bytes[2] == 0 && bytes[3] == version) {
      return DecodeTiff(bytes);
    }
  }
  if (bytes.size() >= 12 && absl::StartsWith(bytes, "RIFF") && bytes.substr(8, 4) == "WEBP") return DecodeWebp(bytes);
  if (absl::StartsWith(bytes, "BM")) return DecodeBmp(bytes);
  if (bytes.size() >= 2 && bytes[0] == 'P' && absl::string_view("2356").find(bytes[1]) != absl::string_view::npos) {
    return DecodePnm(bytes);
  }
  return absl::DataLossError("is not a whole image of a known format (png, jpg, bmp, pgm, ppm, tif, webp)");
}

}  // namespace cairn::io
