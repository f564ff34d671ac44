#include "server/rpc/images.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/image_codecs.h"

namespace cairn::server {
namespace {

Camera CameraOf(int width, int height) {
  return Camera::FromPinhole({width, height, 300.0, 300.0, 0.5 * width, 0.5 * height});
}

cv::Mat Ramp(int width, int height) {
  cv::Mat image(height, width, CV_8UC1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(3 * x + 5 * y);
  }
  return image;
}

bool Equal(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && a.type() == b.type() && cv::countNonZero(a != b) == 0;
}

TEST(Images, GrayRgbAndPngOfTheSameSceneAreTheSame) {
  const cv::Mat ramp = Ramp(20, 10);
  v1::Image gray, rgb, png;
  gray.set_gray(ramp.data, ramp.total());
  for (std::size_t i = 0; i < ramp.total(); ++i) rgb.mutable_rgb()->append(3, static_cast<char>(ramp.data[i]));
  png.set_encoded(*io::EncodePng(ramp, 1));
  for (const v1::Image& image : {gray, rgb, png}) {
    const auto made = GrayImageOf(image, CameraOf(20, 10), {});
    ASSERT_TRUE(made.ok()) << made.status();
    EXPECT_TRUE(Equal(*made, ramp)) << image.content_case();
  }
}

TEST(Images, SixteenBitsBecomeEight) {
  cv::Mat deep;
  Ramp(20, 10).convertTo(deep, CV_16U, 257.0);
  v1::Image image;
  image.set_encoded(*io::EncodePng(deep, 1));
  const auto made = GrayImageOf(image, CameraOf(20, 10), {});
  ASSERT_TRUE(made.ok()) << made.status();
  EXPECT_TRUE(Equal(*made, Ramp(20, 10)));
}

TEST(Images, WhatDoesNotFitItsCameraIsRefused) {
  const auto refused = [](const v1::Image& image, const Camera& camera, const ImageLimits& limits = {}) {
    return GrayImageOf(image, camera, limits).status().code() == absl::StatusCode::kInvalidArgument;
  };
  v1::Image image;
  EXPECT_TRUE(refused(image, CameraOf(20, 10))) << "none";
  image.set_gray(std::string(199, 'x'));
  EXPECT_TRUE(refused(image, CameraOf(20, 10)));
  image.set_rgb(std::string(200, 'x'));
  EXPECT_TRUE(refused(image, CameraOf(20, 10)));
  image.set_encoded(*io::EncodePng(Ramp(20, 10), 1));
  EXPECT_TRUE(refused(image, CameraOf(10, 20)));
  EXPECT_FALSE(refused(image, CameraOf(20, 10)));
  EXPECT_TRUE(refused(image, CameraOf(20, 10), {.max_pixels = 199}));
  image.mutable_encoded()->resize(image.encoded().size() / 2);
  EXPECT_TRUE(refused(image, CameraOf(20, 10))) << "cut";
  image.set_encoded("GIF89a");
  EXPECT_TRUE(refused(image, CameraOf(20, 10)));
}

// A file of some bytes that claims to be as large as its camera: what a stranger says is not allocated.
TEST(Images, TheHeaderIsCheckedBeforeAnythingIsDecoded) {
  std::string bomb = *io::EncodePng(Ramp(20, 10), 1);
  bomb[16] = 0x7f;  // two thousand million pixels wide
  v1::Image image;
  image.set_encoded(bomb);
  const absl::Status status = GrayImageOf(image, CameraOf(20, 10), {}).status();
  EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument);
  EXPECT_THAT(std::string(status.message()), testing::HasSubstr("2130706452x10"));
  Camera huge = CameraOf(20, 10);
  huge.width_px = huge.height_px = 1 << 20;
  EXPECT_THAT(std::string(GrayImageOf(image, huge, {}).status().message()),
              testing::HasSubstr("16 megapixels that this server takes"));
}

}  // namespace
}  // namespace cairn::server
