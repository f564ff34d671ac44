#include "image/view_survey.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "base/random.h"

namespace cairn::image {
namespace {

// A smooth random texture, larger than any view of it.
const cv::Mat& Wall() {
  static const cv::Mat wall = [] {
    Random random(5);
    cv::Mat noise(900, 3000, CV_32F);
    for (int y = 0; y < noise.rows; ++y) {
      for (int x = 0; x < noise.cols; ++x) noise.at<float>(y, x) = static_cast<float>(random.Normal());
    }
    cv::GaussianBlur(noise, noise, {}, 3.0);
    cv::Mat bytes;
    noise.convertTo(bytes, CV_8U, 400.0, 120.0);
    return bytes;
  }();
  return wall;
}

constexpr int kWidth = 480, kHeight = 360;

// A camera that goes along the wall, three pixels per frame, with noise.
cv::Mat View(int frame, double speed_px = 3.0) {
  cv::Mat view = Wall()(cv::Rect(static_cast<int>(speed_px * frame), 100 + (frame * 2) % 50, kWidth, kHeight)).clone();
  Random random(static_cast<std::uint64_t>(frame));
  for (int y = 0; y < kHeight; ++y) {
    auto* row = view.ptr<std::uint8_t>(y);
    for (int x = 0; x < kWidth; ++x) row[x] = cv::saturate_cast<std::uint8_t>(row[x] + 2.0 * random.Normal());
  }
  return view;
}

template <class Spoil>
ViewSurvey Survey(const Spoil& spoil, double speed_px = 3.0) {
  ViewSurveyor surveyor;
  for (int i = 0; i < 24; ++i) {
    cv::Mat image = View(20 * i, speed_px), next = View(20 * i + 1, speed_px);
    spoil(20 * i, &image);
    spoil(20 * i + 1, &next);
    surveyor.Add(image, next);
  }
  return surveyor.Result();
}

TEST(ViewSurvey, AnOrdinaryCameraHasNoneOfIt) {
  const ViewSurvey survey = Survey([](int, cv::Mat*) {});
  EXPECT_TRUE(survey.mask.empty());
  EXPECT_EQ(survey.fixed_share, 0.0);
  EXPECT_FALSE(survey.interlaced);
  EXPECT_EQ(survey.bands.amplitude, 0.0);
}

TEST(ViewSurvey, ACameraThatStandsHasNothingFixed) {
  EXPECT_TRUE(Survey([](int, cv::Mat*) {}, 0.0).mask.empty());
}

TEST(ViewSurvey, WhatIsFixedToTheCameraIsFoundWhateverTheLight) {
  cv::Mat bonnet = cv::Mat::zeros(kHeight, kWidth, CV_8U);
  cv::ellipse(bonnet, {kWidth / 2, kHeight}, {kWidth * 6 / 10, kHeight * 3 / 10}, 0, 0, 360, 255, cv::FILLED);
  const cv::Mat paint = Wall()(cv::Rect(2400, 500, kWidth, kHeight));
  const ViewSurvey survey = Survey([&](int frame, cv::Mat* image) {
    paint.copyTo(*image, bonnet);
    image->convertTo(*image, -1, 1.0 + 0.2 * std::sin(frame), 5.0 * std::cos(frame));
  });
  ASSERT_EQ(survey.mask.size(), bonnet.size());
  const double hidden = cv::countNonZero((survey.mask == 0) & bonnet), all = cv::countNonZero(bonnet);
  EXPECT_GT(hidden, 0.97 * all);
  EXPECT_LT(cv::countNonZero((survey.mask == 0) & (bonnet == 0)), 0.25 * all);  // a margin around it
  EXPECT_NEAR(survey.fixed_share, all / (kWidth * kHeight), 0.05);
}

TEST(ViewSurvey, HalfPicturesAreSeenAndMended) {
  const auto weave = [](int frame, cv::Mat* image) {
    const cv::Mat later = View(frame + 1, 3.0);
    for (int y = 1; y < kHeight; y += 2) later.row(y).copyTo(image->row(y));
  };
  EXPECT_TRUE(Survey(weave).interlaced);
  cv::Mat woven = View(7);
  weave(7, &woven);
  EXPECT_GT(CombStrength(woven), 1.1);
  DropSecondField(&woven);
  EXPECT_LT(CombStrength(woven), 0.9);
  EXPECT_EQ(cv::norm(woven.row(10), View(7).row(10), cv::NORM_INF), 0.0);
}

TEST(ViewSurvey, BandsOfLightAreSeen) {
  for (const double amplitude : {0.05, 0.15}) {
    for (const double periods : {1.0, 3.0, 7.0}) {
      const ViewSurvey survey = Survey([&](int frame, cv::Mat* image) {
        for (int y = 0; y < kHeight; ++y) {
          const double gain =
              1.0 - amplitude + amplitude * std::sin(6.2831853 * (periods * y / kHeight + 0.37 * frame));
          image->row(y).convertTo(image->row(y), -1, gain);
        }
      });
      EXPECT_GT(survey.bands.amplitude, amplitude) << amplitude << " " << periods;
      EXPECT_LT(survey.bands.amplitude, 3.0 * amplitude) << amplitude << " " << periods;
      EXPECT_NEAR(survey.bands.periods, periods, 0.3) << amplitude;
    }
  }
  // Light that changes everywhere alike, or from top to bottom, is none.
  const auto flicker = [](int frame, cv::Mat* image) { image->convertTo(*image, -1, 1.0 + 0.3 * std::sin(frame)); };
  EXPECT_EQ(Survey(flicker).bands.amplitude, 0.0);
}

TEST(ViewSurvey, BandsOfLightAreEvenedOut) {
  const auto light = [](double phase, cv::Mat* image) {
    for (int y = 0; y < kHeight; ++y) {
      image->row(y).convertTo(image->row(y), -1, 0.85 + 0.15 * std::sin(6.2831853 * (3.3 * y / kHeight + phase)));
    }
  };
  cv::Mat one = View(5), other = View(5);
  light(0.1, &one);
  light(0.5, &other);
  const double before = cv::norm(one, other, cv::NORM_L1) / static_cast<double>(one.total());
  EvenOutBands(3.3, &one);
  EvenOutBands(3.3, &other);
  EXPECT_LT(cv::norm(one, other, cv::NORM_L1) / static_cast<double>(one.total()), 0.1 * before);
}

TEST(MaskFiller, LeavesNothingToSeeBehindTheMaskAndTheRestAsItIs) {
  cv::Mat mask(kHeight, kWidth, CV_8U, cv::Scalar(255));
  mask.rowRange(260, kHeight).setTo(0);
  cv::Mat image = View(3), before = image.clone();
  cv::rectangle(image, {100, 280}, {200, 300}, 255, cv::FILLED);
  MaskFiller(mask).Fill(&image);
  EXPECT_EQ(cv::norm(image.rowRange(0, 260), before.rowRange(0, 260), cv::NORM_INF), 0.0);
  cv::Mat dx, dy;
  cv::Sobel(image, dx, CV_32F, 1, 0, 3, 0.125);
  cv::Sobel(image, dy, CV_32F, 0, 1, 3, 0.125);
  EXPECT_LT(cv::norm(dx.rowRange(266, kHeight), cv::NORM_INF), 6.0);
  EXPECT_LT(cv::norm(dy.rowRange(266, kHeight), cv::NORM_INF), 6.0);
  // None, or of another size: nothing happens.
  MaskFiller().Fill(&before);
  MaskFiller(cv::Mat(9, 9, CV_8U, cv::Scalar(0))).Fill(&before);
  MaskFiller(cv::Mat(kHeight, kWidth, CV_8U, cv::Scalar(255))).Fill(&before);
  EXPECT_EQ(cv::norm(before, View(3), cv::NORM_INF), 0.0);
}

}  // namespace
}  // namespace cairn::image
