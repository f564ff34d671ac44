#include "io/intensity_range.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "base/random.h"

namespace cairn::io {
namespace {

// Values from `low` to `high`, most of them in the middle.
cv::Mat Image(double low, double high, std::uint64_t seed = 1) {
  Random random(seed);
  cv::Mat image(120, 160, CV_16UC1);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const double share = 0.5 * (random.Uniform() + random.Uniform());
      image.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(low + share * (high - low));
    }
  }
  return image;
}

IntensityRange RangeOf(const cv::Mat& image) {
  IntensityStatistics statistics;
  statistics.Add(image);
  return statistics.Range();
}

TEST(IntensityRange, AsManyBitsAsTheSensorHas) {
  EXPECT_EQ(RangeOf(Image(0, 250)), (IntensityRange{0, 255}));
  EXPECT_EQ(RangeOf(Image(10, 1000)), (IntensityRange{0, 1023}));
  EXPECT_EQ(RangeOf(Image(200, 4000)), (IntensityRange{0, 4095}));
  EXPECT_EQ(RangeOf(Image(200, 15000)), (IntensityRange{0, 16383}));
  EXPECT_EQ(RangeOf(Image(200, 65000)), IntensityRange());
  EXPECT_EQ(RangeOf(Image(0, 65535)).Describe(), "");
  EXPECT_THAT(RangeOf(Image(200, 4000)).Describe(), testing::HasSubstr("from 0 to 4095"));
}

TEST(IntensityRange, AWindowOfAThermalCamera) {
  const IntensityRange range = RangeOf(Image(7000, 9000));
  EXPECT_LT(range.black, 6500);
  EXPECT_GT(range.black, 5500);
  EXPECT_GT(range.white, 9500);
  EXPECT_LT(range.white, 10500);
  // Nothing but noise is not blown up.
  const IntensityRange flat = RangeOf(Image(8000, 8004));
  EXPECT_GE(flat.white - flat.black, 64.0);
}

TEST(IntensityRange, HotPixelsSayNothing) {
  cv::Mat image = Image(100, 4000);
  image.at<std::uint16_t>(5, 5) = 65535;
  EXPECT_EQ(RangeOf(image), (IntensityRange{0, 4095}));
}

TEST(IntensityRange, OneScaleForAllImages) {
  IntensityStatistics statistics;
  statistics.Add(Image(10, 900));
  statistics.Add(Image(10, 3900));
  statistics.Add(cv::Mat(5, 5, CV_8UC1, cv::Scalar(3)));
  EXPECT_EQ(statistics.Range(), (IntensityRange{0, 4095}));
  EXPECT_TRUE(IntensityStatistics().empty());
  EXPECT_EQ(IntensityStatistics().Range(), IntensityRange());
}

TEST(IntensityRange, BecomesEightBits) {
  cv::Mat image = (cv::Mat_<std::uint16_t>(1, 4) << 0, 100, 300, 500);
  ToEightBits({100, 355}, &image);
  ASSERT_EQ(image.type(), CV_8UC1);
  EXPECT_EQ(image.at<std::uint8_t>(0), 0);
  EXPECT_EQ(image.at<std::uint8_t>(1), 0);
  EXPECT_EQ(image.at<std::uint8_t>(2), 200);
  EXPECT_EQ(image.at<std::uint8_t>(3), 255);
  ToEightBits({100, 355}, &image);
  EXPECT_EQ(image.at<std::uint8_t>(2), 200);
}

}  // namespace
}  // namespace cairn::io
