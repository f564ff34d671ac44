#include "io/image_series.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "absl/strings/str_format.h"
#include "io/testing_folder.h"

namespace cairn::io {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr char kFormat[] = "%s%d%s";

void WriteSeries(const TestingFolder& folder, const std::string& before, const std::string& after, int count,
                 const cv::Mat& image = TestingFolder::Ramp(1)) {
  for (int i = 0; i < count; ++i) folder.WriteImage(absl::StrFormat(kFormat, before, i, after), image);
}

ImageSeries MustFind(const TestingFolder& folder) {
  auto series = FindImageSeries(folder.str(), {32, 24});
  EXPECT_TRUE(series.ok()) << series.status();
  return series.ok() ? *std::move(series) : ImageSeries();
}

std::string Refusal(const TestingFolder& folder) {
  return std::string(FindImageSeries(folder.str(), {32, 24}).status().message());
}

const cv::Mat kDepth(24, 32, CV_16UC1, cv::Scalar(1500));

TEST(NaturalLess, NumbersByTheirValue) {
  const std::vector<std::vector<std::string>> orders = {
      {"0.png", "1.png", "2.png", "10.png", "100.png"},
      {"IMG_1.jpg", "IMG_2.jpg", "IMG_10.jpg", "IMG_300.jpg"},
      {"a1b2.png", "a1b10.png", "a2b1.png"},
      {"000009.png", "000010.png"},
      {"frame.1.png", "frame.2.png", "frame.10.png"},
      {"1305031453.359684.png", "1305031453.391690.png", "1305031454.000001.png"},
      {"01.png", "1.png", "2.png"},
      {"99999999999999999999998.png", "99999999999999999999999.png", "100000000000000000000000.png"}};
  for (std::vector<std::string> order : orders) {
    const std::vector<std::string> sorted = order;
    for (int i = 0; i < 10; ++i) {
      std::shuffle(order.begin(), order.end(), std::mt19937(i));
      std::sort(order.begin(), order.end(), NaturalLess);
      EXPECT_EQ(order, sorted);
    }
  }
}

TEST(ImageSeries, NaturalOrderIsTold) {
  const TestingFolder folder;
  WriteSeries(folder, "", ".png", 12);
  const ImageSeries series = MustFind(folder);
  ASSERT_EQ(series.names.size(), 12u);
  EXPECT_EQ(series.names[2], "2.png");
  EXPECT_EQ(series.names[11], "11.png");
  EXPECT_THAT(series.notes, ElementsAre(AllOf(HasSubstr("order of the numbers"), HasSubstr("0.png to 11.png"))));
}

TEST(ImageSeries, DepthIsLeftOut) {
  for (const auto& [color, depth] :
       std::vector<std::pair<std::string, std::string>>{{"frame-00000|.color.png", "frame-00000|.depth.png"},
                                                        {"frame00000|.png", "depth00000|.png"},
                                                        {"0|.jpg", "0|.png"},
                                                        {"0000|_a.png", "0000|_b.png"},
                                                        {"left_|.png", "disparity_|.png"}}) {
    const TestingFolder folder;
    const auto cut = [](const std::string& name, bool second) {
      return second ? name.substr(name.find('|') + 1) : name.substr(0, name.find('|'));
    };
    WriteSeries(folder, cut(color, false), cut(color, true), 6);
    WriteSeries(folder, cut(depth, false), cut(depth, true), 6, kDepth);
    const ImageSeries series = MustFind(folder);
    ASSERT_EQ(series.names.size(), 6u) << color;
    EXPECT_EQ(series.names[0], cut(color, false) + "0" + cut(color, true));
    EXPECT_THAT(series.notes, ElementsAre(AllOf(HasSubstr("left out"), HasSubstr(cut(depth, true)))));
  }
}

TEST(ImageSeries, TwoCamerasAreRefused) {
  for (const auto& [first, second] :
       std::vector<std::pair<std::string, std::string>>{{"left", "right"}, {"cam0_", "cam1_"}, {"1_00", "2_00"}}) {
    const TestingFolder folder;
    WriteSeries(folder, first, ".png", 9);
    WriteSeries(folder, second, ".png", 9);
    EXPECT_THAT(Refusal(folder),
                AllOf(HasSubstr("several series"), HasSubstr(first + "0.png to " + first + "8.png (9 images)"),
                      HasSubstr(second + "0.png"), HasSubstr("folder of its own")));
  }
}

TEST(ImageSeries, ThoseOfTheCamerasSizeAreTaken) {
  const TestingFolder folder;
  WriteSeries(folder, "big_", ".png", 6);
  WriteSeries(folder, "small_", ".png", 6, cv::Mat(12, 16, CV_8UC1, cv::Scalar(9)));
  EXPECT_EQ(MustFind(folder).names[5], "big_5.png");
}

TEST(ImageSeries, StrayPicturesAreLeftOut) {
  const TestingFolder folder;
  WriteSeries(folder, "IMG_", ".jpg", 9);
  folder.WriteImage("cover.png", 3);
  folder.WriteImage("IMG_4 (1).jpg", 3);
  const ImageSeries series = MustFind(folder);
  EXPECT_EQ(series.names.size(), 9u);
  EXPECT_THAT(series.notes, ElementsAre(AllOf(HasSubstr("cover.png"), HasSubstr("IMG_4 (1).jpg"))));
}

TEST(ImageSeries, OneSeriesStaysOne) {
  for (const std::vector<std::string>& names : std::vector<std::vector<std::string>>{
           {"b.png", "a.png", "c.jpg"},                                                           // words
           {"1305031453.35.png", "1305031453.39.png", "1305031454.35.png", "1305031454.39.png"},  // seconds
           {"img1.png", "img2.jpg", "img3.png", "img4.png"},  // some of another kind
           {"20240101_235959.png", "20240102_000001.png", "20240102_000002.png"},
           {"a3f.png", "b77.png", "c1d2.png", "9ee.png", "77a.png", "0b1c.png", "d4d.png", "e5.png", "f00.png",
            "ab.png"}}) {
    const TestingFolder folder;
    for (const std::string& name : names) folder.WriteImage(name, 3);
    EXPECT_EQ(MustFind(folder).names.size(), names.size()) << names[0];
  }
}

TEST(ImageSeries, AnEmptyFolderHasNone) {
  const TestingFolder folder;
  EXPECT_THAT(MustFind(folder).names, IsEmpty());
  EXPECT_THAT(MustFind(folder).notes, IsEmpty());
}

}  // namespace
}  // namespace cairn::io
