#include <csetjmp>
#include <cstdio>
// jpeglib.h needs the two above.
#include <jerror.h>
#include <jpeglib.h>

#include "io/image_decoders.h"

namespace cairn::io {
namespace {

// Errors leave by longjmp, see png_codec.cc.
struct Reading {
  jpeg_error_mgr errors;  // first: libjpeg gives a pointer to it
  std::jmp_buf escape;
  jpeg_decompress_struct jpeg;
  jpeg_progress_mgr progress;
  bool incomplete = false;
  bool too_many_scans = false;

  ~Reading() { jpeg_destroy_decompress(&jpeg); }
};

Reading* ReadingOf(j_common_ptr jpeg) { return reinterpret_cast<Reading*>(jpeg->err); }

[[noreturn]] void Escape(j_common_ptr jpeg) { std::longjmp(ReadingOf(jpeg)->escape, 1); }
void Silent(j_common_ptr) {}

// The decoder fills what lacks with gray and goes on.
void NoteWarning(j_common_ptr jpeg, int level) {
  const int code = jpeg->err->msg_code;
  if (level < 0 && (code == JWRN_HIT_MARKER || code == JWRN_JPEG_EOF)) ReadingOf(jpeg)->incomplete = true;
}

// Encoders make about ten. Each takes a few bytes of the file, and the time to go through all of the image.
constexpr int kMaxScans = 100;
void CountScans(j_common_ptr jpeg) {
  if (reinterpret_cast<j_decompress_ptr>(jpeg)->input_scan_number <= kMaxScans) return;
  ReadingOf(jpeg)->too_many_scans = true;
  Escape(jpeg);
}

bool ReadHeader(Reading* reading, absl::string_view bytes) {
  jpeg_decompress_struct* jpeg = &reading->jpeg;
  if (setjmp(reading->escape) != 0) return false;
  jpeg_create_decompress(jpeg);
  reading->progress.progress_monitor = CountScans;
  jpeg->progress = &reading->progress;
  jpeg_mem_src(jpeg, reinterpret_cast<const unsigned char*>(bytes.data()), bytes.size());
  return jpeg_read_header(jpeg, TRUE) == JPEG_HEADER_OK;
}

bool ReadPixels(Reading* reading, const cv::Mat& gray) {
  jpeg_decompress_struct* jpeg = &reading->jpeg;
  if (setjmp(reading->escape) != 0) return false;
  jpeg->out_color_space = JCS_GRAYSCALE;
  jpeg_start_decompress(jpeg);
  while (jpeg->output_scanline < jpeg->output_height) {
    JSAMPROW row = gray.data + gray.step[0] * jpeg->output_scanline;
    jpeg_read_scanlines(jpeg, &row, 1);
  }
  jpeg_finish_decompress(jpeg);
  return true;
}

}  // namespace

absl::StatusOr<cv::Mat> DecodeJpeg(absl::string_view bytes) {
  Reading reading = {};
  reading.jpeg.err = jpeg_std_error(&reading.errors);
  reading.errors.error_exit = Escape;
  reading.errors.output_message = Silent;
  reading.errors.emit_message = NoteWarning;
  if (!ReadHeader(&reading, bytes)) return reading.incomplete ? Truncated() : NotWhole();
  if (reading.jpeg.num_components == 4) return absl::InvalidArgumentError("has four colours (CMYK); convert it to RGB");
  CAIRN_ASSIGN_OR_RETURN(cv::Mat gray, NewImage(reading.jpeg.image_width, reading.jpeg.image_height, CV_8UC1));
  if (!ReadPixels(&reading, gray)) {
    if (!reading.too_many_scans) return NotWhole();
    return absl::InvalidArgumentError(
        absl::StrCat("is a progressive JPEG of more than ", kMaxScans, " scans; write it anew"));
  }
  if (reading.incomplete) return Truncated();
  return gray;
}

}  // namespace cairn::io
