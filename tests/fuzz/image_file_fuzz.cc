// Image files of every format that sequences may have.
#include "io/image_codecs.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const absl::StatusOr<cv::Mat> gray = cairn::io::DecodeGray({reinterpret_cast<const char*>(data), size});
  if (gray.ok() && gray->type() != CV_8UC1 && gray->type() != CV_16UC1) std::abort();
  return 0;
}
