// Images as clients send them: a file whose header is believed only as far as its camera goes.
#include "server/rpc/images.h"
#include "wire/image_header.h"

using namespace cairn;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string file(reinterpret_cast<const char*>(data), size);
  const absl::StatusOr<wire::ImageSize> claimed = wire::EncodedImageSize(file);
  if (!claimed.ok()) return 0;
  const Camera camera = Camera::FromPinhole({claimed->width_px, claimed->height_px, 300.0, 300.0, 1.0, 1.0});
  v1::Image image;
  image.set_encoded(file);
  const absl::StatusOr<cv::Mat> gray = server::GrayImageOf(image, camera, {.max_pixels = 100'000});
  if (gray.ok() && (gray->cols != claimed->width_px || gray->rows != claimed->height_px || gray->type() != CV_8UC1)) {
    std::abort();
  }
  return 0;
}
