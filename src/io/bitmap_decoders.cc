// The two kinds of files that are plain pixels: PGM and PPM (netpbm), and BMP.
#include <algorithm>
#include <array>
#include <bit>
#include <optional>
#include <vector>

#include "absl/strings/ascii.h"
#include "io/image_decoders.h"

namespace cairn::io {
namespace {

std::uint8_t ByteAt(absl::string_view bytes, std::size_t at) { return static_cast<std::uint8_t>(bytes[at]); }

std::uint32_t Little(absl::string_view bytes, std::size_t at, int size) {
  std::uint32_t value = 0;
  for (int i = 0; i < size; ++i) value |= static_cast<std::uint32_t>(ByteAt(bytes, at + i)) << (8 * i);
  return value;
}

// The next number of a PGM's header or text, behind blanks and comments.
std::optional<std::uint32_t> TakeNumber(absl::string_view* rest) {
  for (;;) {
    while (!rest->empty() && absl::ascii_isspace(rest->front())) rest->remove_prefix(1);
    if (rest->empty() || rest->front() != '#') break;
    const std::size_t end = rest->find('\n');
    rest->remove_prefix(end == absl::string_view::npos ? rest->size() : end);
  }
  std::optional<std::uint32_t> value;
  while (!rest->empty() && absl::ascii_isdigit(rest->front())) {
    value = std::min(value.value_or(0) * 10 + static_cast<std::uint32_t>(rest->front() - '0'), 100'000'000u);
    rest->remove_prefix(1);
  }
  return value;
}

struct BmpHeader {
  std::int64_t width = 0, height = 0;
  bool top_down = false;
  int bits = 0;
  std::size_t pixels = 0;                      // where they begin
  std::array<std::uint32_t, 3> masks = {};     // red, green, blue; of 16 and 32 bits
  std::array<std::uint8_t, 256> palette = {};  // as gray; of up to 8 bits
};

absl::StatusOr<BmpHeader> ReadBmpHeader(absl::string_view bytes) {
  constexpr std::size_t kFileHeader = 14;
  if (bytes.size() < kFileHeader + 12) return Truncated();
  BmpHeader header;
  header.pixels = Little(bytes, 10, 4);
  const std::size_t size = Little(bytes, 14, 4);
  const bool old = size == 12;  // OS/2
  if (!old && size < 40) return NotWhole();
  if (bytes.size() < kFileHeader + size) return Truncated();
  std::uint32_t compression = 0, colors = 0;
  if (old) {
    header.width = Little(bytes, 18, 2), header.height = Little(bytes, 20, 2);
    header.bits = static_cast<int>(Little(bytes, 24, 2));
  } else {
    header.width = static_cast<std::int32_t>(Little(bytes, 18, 4));
    header.height = static_cast<std::int32_t>(Little(bytes, 22, 4));
    header.bits = static_cast<int>(Little(bytes, 28, 2));
    compression = Little(bytes, 30, 4), colors = Little(bytes, 46, 4);
  }
  header.top_down = header.height < 0;
  header.height = std::abs(header.height);
  constexpr std::uint32_t kPlain = 0, kMasks = 3;
  if (compression != kPlain && compression != kMasks) {
    return absl::InvalidArgumentError("is a compressed BMP; convert it to png");
  }
  if (header.bits == 16) header.masks = {0x7c00, 0x3e0, 0x1f};
  if (header.bits == 32) header.masks = {0xff0000, 0xff00, 0xff};
  if (compression == kMasks) {
    if (bytes.size() < kFileHeader + 52) return Truncated();
    for (int i = 0; i < 3; ++i) header.masks[i] = Little(bytes, kFileHeader + 40 + 4 * i, 4);
  }
  if (header.bits <= 8) {
    const std::size_t entry = old ? 3 : 4, begin = kFileHeader + size;
    const std::size_t count = std::min<std::size_t>(colors > 0 ? colors : 256, std::size_t{1} << header.bits);
    for (std::size_t i = 0; i < count && begin + (i + 1) * entry <= bytes.size(); ++i) {
      const std::size_t at = begin + i * entry;
      header.palette[i] =
          static_cast<std::uint8_t>(Luma(ByteAt(bytes, at + 2), ByteAt(bytes, at + 1), ByteAt(bytes, at)));
    }
  }
  return header;
}

// A channel under its mask, in 8 bits.
std::uint32_t Masked(std::uint32_t pixel, std::uint32_t mask) {
  if (mask == 0) return 0;
  const int shift = std::countr_zero(mask);
  const std::uint64_t most = mask >> shift;
  return static_cast<std::uint32_t>(((pixel & mask) >> shift) * std::uint64_t{255} / most);
}

std::uint32_t BmpPixel(const BmpHeader& header, absl::string_view row, std::size_t x) {
  if (header.bits <= 8) {
    const std::size_t at = x * static_cast<std::size_t>(header.bits);
    const int shift = 8 - header.bits - static_cast<int>(at % 8);
    return header.palette[(ByteAt(row, at / 8) >> shift) & ((1 << header.bits) - 1)];
  }
  const int size = header.bits / 8;
  const std::uint32_t pixel = Little(row, x * static_cast<std::size_t>(size), size);
  if (size == 3) return Luma(pixel >> 16, (pixel >> 8) & 0xff, pixel & 0xff);
  return Luma(Masked(pixel, header.masks[0]), Masked(pixel, header.masks[1]), Masked(pixel, header.masks[2]));
}

// All of one PGM or PPM, by a function that gives the next value.
template <class T, class Next>
bool FillFrom(Next next, int channels, std::uint32_t most, cv::Mat* gray) {
  constexpr std::uint32_t kMost = std::numeric_limits<T>::max();
  for (int y = 0; y < gray->rows; ++y) {
    T* out = gray->ptr<T>(y);
    for (int x = 0; x < gray->cols; ++x) {
      std::uint32_t value[3] = {};
      for (int c = 0; c < channels; ++c) {
        const std::optional<std::uint32_t> read = next();
        if (!read) return false;
        value[c] = std::min(*read, most);
        if (most != kMost) value[c] = (value[c] * kMost + most / 2) / most;
      }
      out[x] = static_cast<T>(channels == 3 ? Luma(value[0], value[1], value[2]) : value[0]);
    }
  }
  return true;
}

}  // namespace

absl::StatusOr<cv::Mat> DecodePnm(absl::string_view bytes) {
  const char kind = bytes[1];
  absl::string_view rest = bytes.substr(2);
  const std::optional<std::uint32_t> width = TakeNumber(&rest), height = TakeNumber(&rest), most = TakeNumber(&rest);
  if (!width || !height || !most || rest.empty()) return Truncated();
  if (*most < 1 || *most > 65535) return NotWhole();
  const bool deep = *most > 255;
  const int channels = kind == '3' || kind == '6' ? 3 : 1;
  CAIRN_ASSIGN_OR_RETURN(cv::Mat gray, NewImage(*width, *height, deep ? CV_16UC1 : CV_8UC1));
  rest.remove_prefix(1);  // the one blank before the pixels
  const auto fill = [&](auto next) {
    return deep ? FillFrom<std::uint16_t>(next, channels, *most, &gray)
                : FillFrom<std::uint8_t>(next, channels, *most, &gray);
  };
  if (kind == '2' || kind == '3') {
    if (!fill([&] { return TakeNumber(&rest); })) return Truncated();
    return gray;
  }
  if (rest.size() < gray.total() * static_cast<std::size_t>(channels) * (deep ? 2 : 1)) return Truncated();
  std::size_t at = 0;
  if (deep) {
    fill([&] {
      at += 2;
      return std::optional<std::uint32_t>(ByteAt(rest, at - 2) << 8 | ByteAt(rest, at - 1));
    });
  } else {
    fill([&] { return std::optional<std::uint32_t>(ByteAt(rest, at++)); });
  }
  return gray;
}

absl::StatusOr<cv::Mat> DecodeBmp(absl::string_view bytes) {
  CAIRN_ASSIGN_OR_RETURN(const BmpHeader header, ReadBmpHeader(bytes));
  constexpr std::array<int, 6> kBits = {1, 4, 8, 16, 24, 32};
  if (std::find(kBits.begin(), kBits.end(), header.bits) == kBits.end()) return NotWhole();
  CAIRN_ASSIGN_OR_RETURN(cv::Mat gray, NewImage(header.width, header.height, CV_8UC1));
  const auto stride = static_cast<std::size_t>((header.width * header.bits + 31) / 32 * 4);
  if (bytes.size() < header.pixels || (bytes.size() - header.pixels) / stride < static_cast<std::size_t>(gray.rows)) {
    return Truncated();
  }
  for (int y = 0; y < gray.rows; ++y) {
    const int line = header.top_down ? y : gray.rows - 1 - y;
    const absl::string_view row = bytes.substr(header.pixels + stride * static_cast<std::size_t>(line), stride);
    auto* out = gray.ptr<std::uint8_t>(y);
    for (int x = 0; x < gray.cols; ++x) {
      out[x] = static_cast<std::uint8_t>(BmpPixel(header, row, static_cast<std::size_t>(x)));
    }
  }
  return gray;
}

}  // namespace cairn::io
