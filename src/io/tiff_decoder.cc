#include <tiffio.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <vector>

#include "io/image_decoders.h"

namespace cairn::io {
namespace {

struct Memory {
  absl::string_view bytes;
  toff_t at = 0;
};

Memory* MemoryOf(thandle_t handle) { return static_cast<Memory*>(handle); }

tmsize_t Read(thandle_t handle, void* to, tmsize_t size) {
  Memory* memory = MemoryOf(handle);
  if (memory->at >= memory->bytes.size()) return 0;
  const auto count = std::min(static_cast<std::size_t>(size), memory->bytes.size() - memory->at);
  std::memcpy(to, memory->bytes.data() + memory->at, count);
  memory->at += count;
  return static_cast<tmsize_t>(count);
}

tmsize_t RefuseWrite(thandle_t, void*, tmsize_t) { return 0; }

toff_t Seek(thandle_t handle, toff_t offset, int whence) {
  Memory* memory = MemoryOf(handle);
  if (whence == SEEK_CUR) offset += memory->at;
  if (whence == SEEK_END) offset += memory->bytes.size();
  return memory->at = offset;
}

int Close(thandle_t) { return 0; }
toff_t Size(thandle_t handle) { return MemoryOf(handle)->bytes.size(); }
int Silent(TIFF*, void*, const char*, const char*, va_list) { return 1; }

using File = std::unique_ptr<TIFF, decltype(&TIFFClose)>;

File OpenIn(Memory* memory) {
  TIFFOpenOptions* options = TIFFOpenOptionsAlloc();
  TIFFOpenOptionsSetErrorHandlerExtR(options, Silent, nullptr);
  TIFFOpenOptionsSetWarningHandlerExtR(options, Silent, nullptr);
  File file(TIFFClientOpenExt("image", "rm", memory, Read, RefuseWrite, Seek, Close, Size, nullptr, nullptr, options),
            TIFFClose);
  TIFFOpenOptionsFree(options);
  return file;
}

// 16 bits a channel, in rows.
absl::StatusOr<cv::Mat> ReadDeep(TIFF* tiff, std::uint32_t width, std::uint32_t height, int channels, bool inverted) {
  CAIRN_ASSIGN_OR_RETURN(cv::Mat gray, NewImage(width, height, CV_16UC1));
  if (TIFFScanlineSize(tiff) != static_cast<tmsize_t>(sizeof(std::uint16_t)) * width * channels) return NotWhole();
  std::vector<std::uint16_t> row(static_cast<std::size_t>(width) * static_cast<std::size_t>(channels));
  for (std::uint32_t y = 0; y < height; ++y) {
    if (TIFFReadScanline(tiff, row.data(), y) != 1) return NotWhole();
    auto* out = gray.ptr<std::uint16_t>(static_cast<int>(y));
    const std::uint16_t* in = row.data();
    for (std::uint32_t x = 0; x < width; ++x, in += channels) {
      const std::uint32_t value = channels >= 3 ? Luma(in[0], in[1], in[2]) : in[0];
      out[x] = static_cast<std::uint16_t>(inverted ? 65535 - value : value);
    }
  }
  return gray;
}

// Everything else, by libtiff's own conversion to RGBA of 8 bits.
absl::StatusOr<cv::Mat> ReadShallow(TIFF* tiff, std::uint32_t width, std::uint32_t height) {
  CAIRN_ASSIGN_OR_RETURN(const cv::Mat rgba, NewImage(width, height, CV_32SC1));
  auto* pixels = reinterpret_cast<std::uint32_t*>(rgba.data);
  if (TIFFReadRGBAImageOriented(tiff, width, height, pixels, ORIENTATION_TOPLEFT, 1) != 1) return NotWhole();
  CAIRN_ASSIGN_OR_RETURN(cv::Mat gray, NewImage(width, height, CV_8UC1));
  for (std::size_t i = 0; i < gray.total(); ++i) {
    const std::uint32_t pixel = pixels[i];
    gray.data[i] = static_cast<std::uint8_t>(Luma(TIFFGetR(pixel), TIFFGetG(pixel), TIFFGetB(pixel)));
  }
  return gray;
}

}  // namespace

absl::StatusOr<cv::Mat> DecodeTiff(absl::string_view bytes) {
  Memory memory = {bytes, 0};
  const File file = OpenIn(&memory);
  TIFF* tiff = file.get();
  std::uint32_t width = 0, height = 0;
  if (tiff == nullptr || TIFFGetField(tiff, TIFFTAG_IMAGEWIDTH, &width) != 1 ||
      TIFFGetField(tiff, TIFFTAG_IMAGELENGTH, &height) != 1) {
    return NotWhole();
  }
  std::uint16_t bits = 1, channels = 1, format = SAMPLEFORMAT_UINT, planar = PLANARCONFIG_CONTIG, kind = 0;
  TIFFGetFieldDefaulted(tiff, TIFFTAG_BITSPERSAMPLE, &bits);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLESPERPIXEL, &channels);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_SAMPLEFORMAT, &format);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_PLANARCONFIG, &planar);
  TIFFGetFieldDefaulted(tiff, TIFFTAG_PHOTOMETRIC, &kind);
  if (bits > 16 || format == SAMPLEFORMAT_IEEEFP) {
    return absl::InvalidArgumentError("has neither 8 nor 16 bits a pixel");
  }
  const bool known = kind == PHOTOMETRIC_MINISBLACK || kind == PHOTOMETRIC_MINISWHITE || kind == PHOTOMETRIC_RGB;
  if (bits == 16 && known && planar == PLANARCONFIG_CONTIG && TIFFIsTiled(tiff) == 0) {
    return ReadDeep(tiff, width, height, channels, kind == PHOTOMETRIC_MINISWHITE);
  }
  return ReadShallow(tiff, width, height);
}

}  // namespace cairn::io
