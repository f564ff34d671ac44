#include "io/image_codecs.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "base/random.h"

namespace cairn::io {
namespace {

using ::testing::HasSubstr;

cv::Mat Noise(int rows, int cols, int type, std::uint64_t seed) {
  Random random(seed);
  cv::Mat image(rows, cols, type);
  const int channels = image.channels();
  for (int y = 0; y < rows; ++y) {
    for (int x = 0; x < cols * channels; ++x) {
      const double value = random.Uniform(0.0, 1.0);
      if (image.depth() == CV_8U) image.ptr<std::uint8_t>(y)[x] = static_cast<std::uint8_t>(255.99 * value);
      if (image.depth() == CV_16U) image.ptr<std::uint16_t>(y)[x] = static_cast<std::uint16_t>(65535.99 * value);
    }
  }
  return image;
}

std::string Encoded(const std::string& extension, const cv::Mat& image, const std::vector<int>& parameters = {}) {
  std::vector<unsigned char> bytes;
  EXPECT_TRUE(cv::imencode(extension, image, bytes, parameters)) << extension;
  return std::string(bytes.begin(), bytes.end());
}

// What OpenCV makes of the same file.
cv::Mat Reference(const std::string& bytes) {
  const std::vector<unsigned char> buffer(bytes.begin(), bytes.end());
  return cv::imdecode(buffer, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
}

void ExpectLikeReference(const std::string& bytes, double tolerance, const std::string& what) {
  const absl::StatusOr<cv::Mat> gray = DecodeGray(bytes);
  ASSERT_TRUE(gray.ok()) << what << ": " << gray.status();
  const cv::Mat want = Reference(bytes);
  ASSERT_EQ(gray->size(), want.size()) << what;
  ASSERT_EQ(gray->type(), want.type()) << what;
  EXPECT_LE(cv::norm(*gray, want, cv::NORM_INF), tolerance) << what;
}

TEST(DecodeGray, AsOpenCvDoes) {
  for (const int width : {1, 7, 32, 45}) {
    const cv::Mat gray = Noise(23, width, CV_8UC1, 1), deep = Noise(23, width, CV_16UC1, 2);
    const cv::Mat color = Noise(23, width, CV_8UC3, 3), alpha = Noise(23, width, CV_8UC4, 4);
    const cv::Mat deep_color = Noise(23, width, CV_16UC3, 5);
    for (const std::string extension : {".png", ".jpg", ".bmp", ".pgm", ".tif"}) {
      ExpectLikeReference(Encoded(extension, gray), 0, extension + " gray");
    }
    for (const std::string extension : {".png", ".pgm", ".tif"}) {
      ExpectLikeReference(Encoded(extension, deep), 0, extension + " of 16 bits");
    }
    for (const std::string extension : {".png", ".jpg"}) {
      ExpectLikeReference(Encoded(extension, color), 0, extension + " of colours");
    }
    ExpectLikeReference(Encoded(".png", alpha), 0, "png with alpha");
    // Two formulas of luma that round differently.
    for (const std::string extension : {".bmp", ".ppm", ".tif", ".webp"}) {
      ExpectLikeReference(Encoded(extension, color), 1, extension + " of colours");
    }
    for (const std::string extension : {".png", ".ppm", ".tif"}) {
      ExpectLikeReference(Encoded(extension, deep_color), 4, extension + " of deep colours");
    }
    ExpectLikeReference(Encoded(".ppm", color, {cv::IMWRITE_PXM_BINARY, 0}), 1, "ppm in text");
    ExpectLikeReference(Encoded(".pgm", gray, {cv::IMWRITE_PXM_BINARY, 0}), 0, "pgm in text");
    ExpectLikeReference(Encoded(".jpg", color, {cv::IMWRITE_JPEG_PROGRESSIVE, 1}), 0, "progressive jpg");
    ExpectLikeReference(Encoded(".bmp", alpha), 1, "bmp with alpha");
  }
}

TEST(DecodeGray, ScalesPgmByItsLargestValue) {
  const auto gray = DecodeGray("P2 # three pixels\n3 1\n# ten bits\n1023\n0 511 1023\n");
  ASSERT_TRUE(gray.ok()) << gray.status();
  ASSERT_EQ(gray->type(), CV_16UC1);
  EXPECT_EQ(gray->at<std::uint16_t>(0, 0), 0);
  EXPECT_NEAR(gray->at<std::uint16_t>(0, 1), 65535 * 511 / 1023, 1);
  EXPECT_EQ(gray->at<std::uint16_t>(0, 2), 65535);
}

// 2x2 px, 4 bits, bottom row first.
TEST(DecodeGray, BmpWithPalette) {
  std::string bmp = "BM";
  const auto add = [&](std::uint32_t value, int size) {
    for (int i = 0; i < size; ++i) bmp.push_back(static_cast<char>(value >> (8 * i)));
  };
  for (const std::uint32_t value : {78u, 0u, 70u, 40u, 2u, 2u}) add(value, 4);
  add(1, 2), add(4, 2);
  for (const std::uint32_t value : {0u, 8u, 0u, 0u, 4u, 0u}) add(value, 4);
  for (const std::uint32_t color : {0x000000u, 0xffffffu, 0xff0000u, 0x0000ffu}) add(color, 4);
  add(0x21, 4), add(0x03, 4);
  const auto gray = DecodeGray(bmp);
  ASSERT_TRUE(gray.ok()) << gray.status();
  const cv::Mat want = (cv::Mat_<std::uint8_t>(2, 2) << 0, 29, 76, 255);
  EXPECT_EQ(cv::norm(*gray, want, cv::NORM_INF), 0) << *gray;
}

TEST(DecodeGray, SaysWhatItCannotRead) {
  EXPECT_EQ(DecodeGray("").status().code(), absl::StatusCode::kDataLoss);
  EXPECT_THAT(std::string(DecodeGray("GIF89a").status().message()), HasSubstr("known format"));
  EXPECT_THAT(std::string(DecodeGray("P5\n100000 100000\n255\n").status().message()), HasSubstr("100000x100000 px"));
  std::string bmp = Encoded(".bmp", Noise(4, 4, CV_8UC1, 1));
  bmp[30] = 1;
  EXPECT_THAT(std::string(DecodeGray(bmp).status().message()), HasSubstr("compressed BMP"));
}

// A few bytes that take the time to go through all of the image, again and again.
TEST(DecodeGray, AJpegOfThousandsOfScansIsRefused) {
  const std::string good = Encoded(".jpg", Noise(64, 64, CV_8UC1, 1), {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  EXPECT_TRUE(DecodeGray(good).ok());
  const std::size_t last = good.rfind("\xFF\xDA"), end = good.rfind("\xFF\xD9");
  ASSERT_LT(last, end);
  std::string many = good.substr(0, end);
  for (int i = 0; i < 200; ++i) many += good.substr(last, end - last);
  EXPECT_THAT(std::string(DecodeGray(many + good.substr(end)).status().message()), HasSubstr("more than 100 scans"));
}

TEST(DecodeGray, TruncatedAtAnyByte) {
  for (const std::string extension : {".png", ".jpg", ".bmp", ".ppm", ".webp"}) {
    const std::string bytes = Encoded(extension, Noise(9, 11, CV_8UC3, 6));
    for (std::size_t size = 0; size + 1 < bytes.size(); ++size) {
      EXPECT_EQ(DecodeGray(bytes.substr(0, size)).status().code(), absl::StatusCode::kDataLoss) << extension << size;
    }
  }
}

// An answer or an error, whatever the bytes are.
TEST(DecodeGray, DamagedAtAnyByte) {
  Random random(8);
  for (const std::string extension : {".png", ".jpg", ".bmp", ".ppm", ".tif", ".webp"}) {
    const std::string bytes = Encoded(extension, Noise(9, 11, CV_8UC3, 7));
    for (std::size_t at = 0; at < bytes.size(); ++at) {
      std::string damaged = bytes;
      damaged[at] = static_cast<char>(random.Uniform(0.0, 255.9));
      const auto gray = DecodeGray(damaged);
      EXPECT_TRUE(!gray.ok() || !gray->empty());
    }
  }
}

TEST(EncodePng, IsReadBack) {
  for (const cv::Mat& image : {Noise(13, 17, CV_8UC1, 9), Noise(13, 17, CV_16UC1, 10)}) {
    const auto png = EncodePng(image, 1);
    ASSERT_TRUE(png.ok()) << png.status();
    EXPECT_EQ(cv::norm(*DecodeGray(*png), image, cv::NORM_INF), 0);
    EXPECT_EQ(cv::norm(Reference(*png), image, cv::NORM_INF), 0);
  }
  EXPECT_EQ(EncodePng(Noise(2, 2, CV_8UC3, 1), 1).status().code(), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::io
