#include "image/photometric_tracks.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>

#include "base/random.h"

namespace cairn::image {
namespace {

// A random pattern of gray patches that slides under the camera, brighter and darker from frame to frame.
class Slide {
 public:
  Slide() : pattern_(300, 700, CV_32FC1) {
    Random random(3);
    for (int y = 0; y < pattern_.rows; y += 20) {
      for (int x = 0; x < pattern_.cols; x += 20) {
        pattern_(cv::Rect(x, y, 20, 20)).setTo(40.0 + 130.0 * random.Uniform());
      }
    }
    cv::GaussianBlur(pattern_, pattern_, cv::Size(), 0.8);
  }
  static double Gain(int frame) { return std::exp(0.35 * std::sin(0.5 * frame)); }
  cv::Mat Image(int frame) const {
    cv::Mat image;
    pattern_(cv::Rect(6 * frame, 10, 320, 240)).convertTo(image, CV_8U, Gain(frame));
    return image;
  }

 private:
  cv::Mat pattern_;
};

TEST(PhotometricTracker, FollowsPointsThroughChangesOfBrightness) {
  const Slide slide;
  PhotometricTracker tracker;
  constexpr int kFrames = 24;
  for (int i = 0; i < kFrames; ++i) ASSERT_TRUE(tracker.Add(slide.Image(i), true).ok());
  EXPECT_EQ(tracker.frames(), kFrames);
  std::map<int, std::vector<PhotometricSample>> points;
  for (const PhotometricSample& sample : tracker.samples()) {
    EXPECT_GE(sample.radius, 0.0);
    EXPECT_LE(sample.radius, 1.0);
    EXPECT_GT(sample.sigma_gray, 1.0);
    points[sample.point].push_back(sample);
  }
  int right = 0, all = 0, dark = 0, long_tracks = 0;
  for (const auto& [point, samples] : points) {
    long_tracks += samples.size() >= 10 ? 1 : 0;
    const double light = samples.front().intensity / Slide::Gain(samples.front().frame);
    dark += light < 90.0 ? 1 : 0;
    for (const PhotometricSample& sample : samples) {
      ++all;
      const double expected = light * Slide::Gain(sample.frame);
      if (expected > 250.0 || std::abs(sample.intensity - expected) < 4.0) ++right;
    }
  }
  EXPECT_GT(long_tracks, 100);
  EXPECT_GT(right, 0.97 * all) << right << " of " << all;
  EXPECT_GT(dark, static_cast<int>(points.size()) / 5);  // both sides of an edge are sampled
  EXPECT_LT(dark, static_cast<int>(points.size()) * 4 / 5);
}

TEST(PhotometricTracker, ImagesBetweenSamplesOnlyHelpToFollow) {
  const Slide slide;
  PhotometricTracker tracker;
  for (int i = 0; i < 13; ++i) ASSERT_TRUE(tracker.Add(slide.Image(i), i % 3 == 0).ok());
  EXPECT_EQ(tracker.frames(), 5);
  int last = 0;
  for (const PhotometricSample& sample : tracker.samples()) last = std::max(last, sample.frame);
  EXPECT_EQ(last, 4);
}

TEST(PhotometricTracker, RefusesOtherImages) {
  PhotometricTracker tracker;
  EXPECT_FALSE(tracker.Add(cv::Mat(), true).ok());
  EXPECT_FALSE(tracker.Add(cv::Mat::zeros(100, 100, CV_8UC3), true).ok());
  EXPECT_FALSE(tracker.Add(cv::Mat::zeros(20, 20, CV_8UC1), true).ok());
  ASSERT_TRUE(tracker.Add(cv::Mat::zeros(100, 100, CV_8UC1), true).ok());
  EXPECT_FALSE(tracker.Add(cv::Mat::zeros(100, 120, CV_8UC1), true).ok());
  EXPECT_TRUE(tracker.samples().empty());  // a black image has no corners
  PhotometricTrackOptions options;
  options.noise_gray = 0.0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace cairn::image
