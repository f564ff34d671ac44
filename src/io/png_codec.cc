#include <png.h>

#include <csetjmp>
#include <cstring>
#include <vector>

#include "io/image_codecs.h"
#include "io/image_decoders.h"

namespace cairn::io {
namespace {

// libpng reports errors by longjmp, over frames that must have nothing to destroy: what the functions that call
// setjmp() work on belongs to their callers.
struct PngReading {
  absl::string_view rest;
  png_structp png = nullptr;
  png_infop info = nullptr;
  png_uint_32 width = 0, height = 0;
  bool deep = false;
  std::vector<png_bytep> rows;

  ~PngReading() { png_destroy_read_struct(&png, &info, nullptr); }
};

void Silent(png_structp, png_const_charp) {}
[[noreturn]] void Escape(png_structp png, png_const_charp) { png_longjmp(png, 1); }

void Take(png_structp png, png_bytep to, std::size_t size) {
  auto* reading = static_cast<PngReading*>(png_get_io_ptr(png));
  if (size > reading->rest.size()) png_error(png, "truncated");
  std::memcpy(to, reading->rest.data(), size);
  reading->rest.remove_prefix(size);
}

// Chunks that have nothing to do with the pixels: names of four letters and a zero each.
constexpr png_byte kNotRead[] = "tEXt\0zTXt\0iTXt\0sPLT\0eXIf";
constexpr int kNumNotRead = 5;
static_assert(sizeof(kNotRead) == 5 * kNumNotRead);

// Up to the pixels, and how they are to come out.
bool ReadHeader(PngReading* reading) {
  png_structp png = reading->png;
  png_infop info = reading->info;
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_read_fn(png, reading, Take);
  // A thousand texts of 8 MB each would be kept, of a file of 8 MB.
  png_set_keep_unknown_chunks(png, PNG_HANDLE_CHUNK_NEVER, kNotRead, kNumNotRead);
  png_read_info(png, info);
  reading->width = png_get_image_width(png, info), reading->height = png_get_image_height(png, info);
  const int color = png_get_color_type(png, info), bits = png_get_bit_depth(png, info);
  reading->deep = bits == 16;
  png_set_strip_alpha(png);
  if (reading->deep) png_set_swap(png);  // to little endian
  if (color == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png);
  if ((color & PNG_COLOR_MASK_COLOR) == 0 && bits < 8) png_set_expand_gray_1_2_4_to_8(png);
  if ((color & PNG_COLOR_MASK_COLOR) != 0) png_set_rgb_to_gray(png, PNG_ERROR_ACTION_NONE, 0.299, 0.587);
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  return true;
}

bool ReadPixels(PngReading* reading) {
  if (setjmp(png_jmpbuf(reading->png)) != 0) return false;
  png_read_image(reading->png, reading->rows.data());
  png_read_end(reading->png, nullptr);
  return true;
}

struct Writing {
  std::string* out = nullptr;
  png_structp png = nullptr;
  png_infop info = nullptr;

  ~Writing() { png_destroy_write_struct(&png, &info); }
};

void Give(png_structp png, png_bytep data, std::size_t size) {
  static_cast<Writing*>(png_get_io_ptr(png))->out->append(reinterpret_cast<const char*>(data), size);
}

bool Write(Writing* writing, const cv::Mat& gray, int compression) {
  png_structp png = writing->png;
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_set_write_fn(png, writing, Give, nullptr);
  png_set_compression_level(png, compression);
  png_set_filter(png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
  const int bits = gray.depth() == CV_16U ? 16 : 8;
  png_set_IHDR(png, writing->info, static_cast<png_uint_32>(gray.cols), static_cast<png_uint_32>(gray.rows), bits,
               PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  png_write_info(png, writing->info);
  if (bits == 16) png_set_swap(png);
  for (int y = 0; y < gray.rows; ++y) png_write_row(png, gray.ptr<png_byte>(y));
  png_write_end(png, nullptr);
  return true;
}

}  // namespace

absl::StatusOr<cv::Mat> DecodePng(absl::string_view bytes) {
  PngReading reading;
  reading.rest = bytes;
  reading.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, nullptr, Escape, Silent);
  if (reading.png != nullptr) reading.info = png_create_info_struct(reading.png);
  if (reading.info == nullptr) return absl::ResourceExhaustedError("cannot be decoded: no memory");
  if (!ReadHeader(&reading)) return NotWhole();
  CAIRN_ASSIGN_OR_RETURN(cv::Mat gray, NewImage(reading.width, reading.height, reading.deep ? CV_16UC1 : CV_8UC1));
  if (png_get_rowbytes(reading.png, reading.info) != gray.step[0]) return NotWhole();
  for (int y = 0; y < gray.rows; ++y) reading.rows.push_back(gray.ptr(y));
  if (!ReadPixels(&reading)) return NotWhole();
  return gray;
}

absl::StatusOr<std::string> EncodePng(const cv::Mat& gray, int compression) {
  if (gray.empty() || (gray.type() != CV_8UC1 && gray.type() != CV_16UC1)) {
    return absl::InvalidArgumentError("only gray images of 8 or 16 bits can be written");
  }
  std::string out;
  Writing writing;
  writing.out = &out;
  writing.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, nullptr, Escape, Silent);
  if (writing.png != nullptr) writing.info = png_create_info_struct(writing.png);
  if (writing.info == nullptr || !Write(&writing, gray, compression)) {
    return absl::ResourceExhaustedError("cannot compress an image: no memory");
  }
  return out;
}

}  // namespace cairn::io
