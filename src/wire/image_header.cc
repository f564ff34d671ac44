#include "wire/image_header.h"

#include <cstdint>

#include "absl/strings/match.h"

namespace cairn::wire {
namespace {

std::uint32_t BigEndian(absl::string_view file, std::size_t at, int bytes) {
  std::uint32_t value = 0;
  for (int i = 0; i < bytes; ++i)
    value = value << 8 | static_cast<std::uint8_t>(file[at + static_cast<std::size_t>(i)]);
  return value;
}

absl::StatusOr<ImageSize> Checked(std::uint32_t width, std::uint32_t height) {
  if (width == 0 || height == 0 || width > INT32_MAX || height > INT32_MAX) {
    return absl::InvalidArgumentError("image: the file says that it has no pixels");
  }
  return ImageSize{static_cast<int>(width), static_cast<int>(height)};
}

absl::Status Cut() { return absl::InvalidArgumentError("image: the file ends before it says how large it is"); }

// The first chunk of every PNG is IHDR (PNG specification, 11.2.2).
absl::StatusOr<ImageSize> PngSize(absl::string_view file) {
  if (file.size() < 24) return Cut();
  if (file.substr(12, 4) != "IHDR") return absl::InvalidArgumentError("image: this PNG has no header");
  return Checked(BigEndian(file, 16, 4), BigEndian(file, 20, 4));
}

// Segments until the first frame header, SOF0 to SOF15 but for DHT, JPG and DAC (ITU-T T.81, B.1 and B.2.2).
absl::StatusOr<ImageSize> JpegSize(absl::string_view file) {
  std::size_t at = 2;
  for (;;) {
    if (at + 2 > file.size()) return Cut();
    if (static_cast<std::uint8_t>(file[at]) != 0xFF) return absl::InvalidArgumentError("image: this JPEG is broken");
    const auto marker = static_cast<std::uint8_t>(file[at + 1]);
    if (marker == 0xFF) {  // fill
      ++at;
      continue;
    }
    at += 2;
    if (marker == 0x01 || (marker >= 0xD0 && marker <= 0xD8)) continue;  // of no length
    if (at + 2 > file.size()) return Cut();
    const std::uint32_t length = BigEndian(file, at, 2);
    if (length < 2 || marker == 0xD9 || marker == 0xDA) {
      return absl::InvalidArgumentError("image: this JPEG has no frame header");
    }
    const bool frame = marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (frame) {
      if (at + 7 > file.size()) return Cut();
      return Checked(BigEndian(file, at + 5, 2), BigEndian(file, at + 3, 2));
    }
    at += length;
  }
}

}  // namespace

absl::StatusOr<ImageSize> EncodedImageSize(absl::string_view file) {
  if (absl::StartsWith(file, "\x89PNG\r\n\x1a\n")) return PngSize(file);
  if (absl::StartsWith(file, "\xFF\xD8")) return JpegSize(file);
  return absl::InvalidArgumentError("image: the file is neither a PNG nor a JPEG");
}

}  // namespace cairn::wire
