#include "server/rpc/images.h"

#include "io/image_codecs.h"
#include "io/image_decoders.h"
#include "wire/image_header.h"

namespace cairn::server {
namespace {

absl::Status CheckBytes(std::size_t bytes, const Camera& camera, std::int64_t per_pixel) {
  const std::int64_t expected = per_pixel * camera.width_px * camera.height_px;
  if (static_cast<std::int64_t>(bytes) == expected) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat("image: it has ", bytes, " bytes, but the camera's ", camera.width_px,
                                                 "x", camera.height_px, " px take ", expected));
}

cv::Mat GrayOfRgb(const std::string& rgb, const Camera& camera) {
  cv::Mat gray(camera.height_px, camera.width_px, CV_8UC1);
  const auto* in = reinterpret_cast<const std::uint8_t*>(rgb.data());
  for (int y = 0; y < gray.rows; ++y) {
    auto* out = gray.ptr<std::uint8_t>(y);
    for (int x = 0; x < gray.cols; ++x, in += 3) out[x] = static_cast<std::uint8_t>(io::Luma(in[0], in[1], in[2]));
  }
  return gray;
}

absl::StatusOr<cv::Mat> Decode(const std::string& file, const Camera& camera) {
  CAIRN_ASSIGN_OR_RETURN(const wire::ImageSize size, wire::EncodedImageSize(file));
  if (size.width_px != camera.width_px || size.height_px != camera.height_px) {
    return absl::InvalidArgumentError(absl::StrCat("image: the file has ", size.width_px, "x", size.height_px,
                                                   " px, its camera ", camera.width_px, "x", camera.height_px));
  }
  absl::StatusOr<cv::Mat> decoded = io::DecodeGray(file);
  if (!decoded.ok()) return absl::InvalidArgumentError(absl::StrCat("image: the file ", decoded.status().message()));
  cv::Mat image = *std::move(decoded);
  if (image.depth() == CV_16U) image.convertTo(image, CV_8U, 1.0 / 257.0);
  return image;
}

}  // namespace

absl::Status CheckImageSize(const Camera& camera, const ImageLimits& limits) {
  if (std::int64_t{camera.width_px} * camera.height_px <= limits.max_pixels) return absl::OkStatus();
  return absl::InvalidArgumentError(absl::StrCat(
      "image: ", camera.width_px, "x", camera.height_px, " px are more than the ",
      1e-6 * static_cast<double>(limits.max_pixels), " megapixels that this server takes (--max-image-megapixels)"));
}

absl::StatusOr<cv::Mat> GrayImageOf(const v1::Image& image, const Camera& camera, const ImageLimits& limits) {
  CAIRN_RETURN_IF_ERROR(CheckImageSize(camera, limits));
  switch (image.content_case()) {
    case v1::Image::kGray: {
      CAIRN_RETURN_IF_ERROR(CheckBytes(image.gray().size(), camera, 1));
      // Nobody writes to a query's image; cv::Mat knows no other way to say so.
      auto* bytes = const_cast<char*>(image.gray().data());
      return cv::Mat(camera.height_px, camera.width_px, CV_8UC1, bytes);
    }
    case v1::Image::kRgb: {
      CAIRN_RETURN_IF_ERROR(CheckBytes(image.rgb().size(), camera, 3));
      return GrayOfRgb(image.rgb(), camera);
    }
    case v1::Image::kEncoded:
      return Decode(image.encoded(), camera);
    case v1::Image::CONTENT_NOT_SET:
      break;
  }
  return absl::InvalidArgumentError("image: send one, as gray, rgb, or encoded (a PNG or JPEG file)");
}

}  // namespace cairn::server
