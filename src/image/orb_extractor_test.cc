#include "image/orb_extractor.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <set>
#include <utility>
#include <vector>

#include "base/random.h"
#include "image/matching.h"
#include "image/orb_detection.h"

namespace cairn::image {
namespace {

// Overlapping rectangles of random shades, slightly blurred and noisy: corners everywhere.
cv::Mat RectangleImage(int width, int height, std::uint64_t seed, int count = 400) {
  Random random(seed);
  cv::Mat image(height, width, CV_8UC1, cv::Scalar(128));
  for (int i = 0; i < count; ++i) {
    const cv::Point2f centre(static_cast<float>(random.Uniform(0, width)),
                             static_cast<float>(random.Uniform(0, height)));
    const cv::Size2f size(static_cast<float>(random.Uniform(8, 60)), static_cast<float>(random.Uniform(8, 60)));
    cv::Point2f corners[4];
    cv::RotatedRect(centre, size, static_cast<float>(random.Uniform(0, 90))).points(corners);
    std::vector<cv::Point> polygon(corners, corners + 4);
    cv::fillConvexPoly(image, polygon, cv::Scalar(random.Uniform(20, 235)), cv::LINE_AA);
  }
  cv::GaussianBlur(image, image, {}, 0.8);
  return image;
}

// Bright and dark Gaussian spots at sub-pixel centres on a grid.
cv::Mat SpotImage(int width, int height, double sigma_px, std::uint64_t seed, std::vector<cv::Point2d>* centers) {
  Random random(seed);
  cv::Mat image(height, width, CV_32FC1, cv::Scalar(128));
  const double step = 12.0 * sigma_px;
  for (double gy = step; gy < height - step; gy += step) {
    for (double gx = step; gx < width - step; gx += step) {
      const cv::Point2d centre(gx + random.Uniform(-1, 1), gy + random.Uniform(-1, 1));
      const float sign = random.Uniform() < 0.5 ? -1.0f : 1.0f;
      centers->push_back(centre);
      const int reach = static_cast<int>(std::ceil(5 * sigma_px));
      const int cx = static_cast<int>(centre.x), cy = static_cast<int>(centre.y);
      for (int y = cy - reach; y <= cy + reach; ++y) {
        for (int x = cx - reach; x <= cx + reach; ++x) {
          if (x < 0 || y < 0 || x >= width || y >= height) continue;
          const double r2 = (x - centre.x) * (x - centre.x) + (y - centre.y) * (y - centre.y);
          image.at<float>(y, x) += sign * 110.0f * static_cast<float>(std::exp(-0.5 * r2 / (sigma_px * sigma_px)));
        }
      }
    }
  }
  cv::Mat bytes;
  image.convertTo(bytes, CV_8U);
  return bytes;
}

Features MustExtract(const cv::Mat& image, int count = 0, const OrbParameters& parameters = {}) {
  absl::StatusOr<Features> features = OrbExtractor(parameters).Extract(image, count);
  EXPECT_TRUE(features.ok()) << features.status();
  return features.ok() ? *std::move(features) : Features{};
}

TEST(OrbExtractor, KeypointsOfEveryOctaveAreUnbiasedInFullResolutionPixels) {
  struct Sum {
    double x = 0, y = 0, squares = 0;
    int count = 0;
  };
  std::vector<Sum> sums(8);
  const OrbParameters parameters;
  for (const double sigma_px : {1.5, 2.2, 3.2, 4.5}) {
    std::vector<cv::Point2d> centers;
    const cv::Mat image = SpotImage(800, 600, sigma_px, 5, &centers);
    for (const Keypoint& keypoint : MustExtract(image).keypoints) {
      const double scale = parameters.Scale(keypoint.octave);
      for (const cv::Point2d& centre : centers) {
        const double dx = keypoint.x_px - centre.x, dy = keypoint.y_px - centre.y;
        if (std::hypot(dx, dy) > 1.5 * scale) continue;
        Sum& sum = sums[keypoint.octave];
        sum.x += dx / scale;
        sum.y += dy / scale;
        sum.squares += (dx * dx + dy * dy) / (scale * scale);
        ++sum.count;
      }
    }
  }
  // With the half-pixel offset of resizing forgotten, octave 7 would be off by 0.36.
  for (std::size_t octave = 0; octave < sums.size(); ++octave) {
    const Sum& sum = sums[octave];
    ASSERT_GE(sum.count, 50) << "octave " << octave;
    EXPECT_NEAR(sum.x / sum.count, 0.0, 0.05) << "octave " << octave;
    EXPECT_NEAR(sum.y / sum.count, 0.0, 0.05) << "octave " << octave;
    // Spots much larger than FAST's circle are flat on top.
    EXPECT_LT(std::sqrt(sum.squares / sum.count), 0.45) << "octave " << octave;
  }
}

TEST(OrbExtractor, LowersTheThresholdWhereACellIsEmpty) {
  cv::Mat image = RectangleImage(320, 240, 12, 60);
  image.convertTo(image, CV_8U, 0.4, 70);
  // One pass over all at the lower threshold, then the rule by hand.
  const auto cell = [](const internal::Corner& c) { return std::pair(c.x / 32, c.y / 32); };
  std::vector<cv::KeyPoint> all;
  cv::FAST(image, all, 7, true);
  std::vector<internal::Corner> expected;
  std::set<std::pair<int, int>> strong;
  for (const cv::KeyPoint& point : all) {
    const internal::Corner corner{static_cast<std::int16_t>(point.pt.x), static_cast<std::int16_t>(point.pt.y),
                                  static_cast<std::int16_t>(point.response)};
    if (corner.x < 16 || corner.y < 16 || corner.x >= 304 || corner.y >= 224) continue;
    expected.push_back(corner);
    if (corner.score >= 20) strong.insert(cell(corner));
  }
  std::erase_if(expected, [&](const internal::Corner& c) { return c.score < 20 && strong.contains(cell(c)); });
  std::vector<internal::Corner> found = internal::DetectCorners(image, 20, 7);
  const auto raster = [](const internal::Corner& a, const internal::Corner& b) {
    return std::pair(a.y, a.x) < std::pair(b.y, b.x);
  };
  std::sort(found.begin(), found.end(), raster);
  EXPECT_EQ(found, expected);
  const auto weak = std::count_if(found.begin(), found.end(), [](const auto& c) { return c.score < 20; });
  EXPECT_GT(weak, 5);
  EXPECT_GT(static_cast<std::ptrdiff_t>(found.size()) - weak, 5);
}

TEST(OrbExtractor, RefinementFindsSubPixelCentres) {
  std::vector<cv::Point2d> centers;
  const cv::Mat image = SpotImage(400, 300, 1.8, 9, &centers);
  double refined_squares = 0.0, integer_squares = 0.0;
  int count = 0;
  for (const internal::Corner& corner : internal::DetectCorners(image, 20, 7)) {
    const cv::Point2f refined = internal::RefineCorner(image, corner);
    for (const cv::Point2d& centre : centers) {
      if (std::hypot(corner.x - centre.x, corner.y - centre.y) > 1.0) continue;
      refined_squares += std::pow(refined.x - centre.x, 2) + std::pow(refined.y - centre.y, 2);
      integer_squares += std::pow(corner.x - centre.x, 2) + std::pow(corner.y - centre.y, 2);
      ++count;
    }
  }
  ASSERT_GT(count, 50);
  EXPECT_LT(std::sqrt(refined_squares / count), 0.2);
  EXPECT_LT(refined_squares, 0.3 * integer_squares);
}

// The share of matches that fit the warp, and how far their rotation is from `turn_rad` on average.
void ExpectMatchesUnderSimilarity(double turn_rad, double scale, double min_share, std::size_t min_matches) {
  const cv::Mat image = RectangleImage(640, 480, 3);
  // Clockwise on the screen (y down) for a positive turn.
  const double c = scale * std::cos(turn_rad), s = scale * std::sin(turn_rad);
  const cv::Matx23d warp(c, -s, 319.5 - c * 319.5 + s * 239.5, s, c, 239.5 - s * 319.5 - c * 239.5);
  cv::Mat turned;
  cv::warpAffine(image, turned, warp, image.size(), cv::INTER_LINEAR);
  const Features a = MustExtract(turned), b = MustExtract(image);
  const std::vector<FeatureMatch> matches = MatchBruteForce(a, b);
  ASSERT_GE(matches.size(), min_matches);
  std::size_t good = 0;
  double sine = 0.0, cosine = 0.0;
  for (const FeatureMatch& match : matches) {
    const Keypoint &ka = a.keypoints[match.a], &kb = b.keypoints[match.b];
    const cv::Vec2d expected = warp * cv::Vec3d(kb.x_px, kb.y_px, 1.0);
    const double tolerance_px = 3.0 * std::pow(1.2, ka.octave);
    good += std::hypot(expected[0] - ka.x_px, expected[1] - ka.y_px) < tolerance_px;
    sine += std::sin(ka.angle_rad - kb.angle_rad);
    cosine += std::cos(ka.angle_rad - kb.angle_rad);
  }
  EXPECT_GE(static_cast<double>(good), min_share * static_cast<double>(matches.size()));
  EXPECT_NEAR(std::remainder(std::atan2(sine, cosine) - turn_rad, 2 * std::numbers::pi), 0.0, 0.03);
}

TEST(OrbExtractor, MatchesSurviveRotation) {
  ExpectMatchesUnderSimilarity(30.0 * std::numbers::pi / 180.0, 1.0, 0.95, 300);
  ExpectMatchesUnderSimilarity(160.0 * std::numbers::pi / 180.0, 1.0, 0.95, 300);
}

TEST(OrbExtractor, MatchesSurviveScale) { ExpectMatchesUnderSimilarity(0.1, 0.7, 0.9, 150); }

TEST(OrbExtractor, DescriptorsAreThoseOfOpenCv) {
  const cv::Mat image = RectangleImage(640, 480, 8);
  const Features features = MustExtract(image);
  std::vector<internal::Corner> corners = internal::DetectCorners(image, 20, 7);
  int compared = 0;
  const cv::Ptr<cv::ORB> orb = cv::ORB::create(10, 1.2f, 1, 16);
  for (std::size_t i = 0; i < features.size() && compared < 50; ++i) {
    const Keypoint& keypoint = features.keypoints[i];
    if (keypoint.octave != 0) continue;
    for (const internal::Corner& corner : corners) {
      const cv::Point2f refined = internal::RefineCorner(image, corner);
      // Positions are kept to 1/32 px.
      if (std::abs(refined.x - keypoint.x_px) > 1.0f / 64 || std::abs(refined.y - keypoint.y_px) > 1.0f / 64) continue;
      std::vector<cv::KeyPoint> point = {cv::KeyPoint(static_cast<float>(corner.x), static_cast<float>(corner.y), 31.0f,
                                                      keypoint.angle_rad * 180.0f / std::numbers::pi_v<float>)};
      cv::Mat bytes;
      orb->compute(image, point, bytes);
      ASSERT_EQ(bytes.rows, 1);
      Descriptor expected{};
      for (int k = 0; k < 32; ++k) {
        expected[k / 8] |= static_cast<std::uint64_t>(bytes.at<std::uint8_t>(0, k)) << (8 * (k % 8));
      }
      EXPECT_EQ(features.descriptors[i], expected);
      ++compared;
    }
  }
  EXPECT_GE(compared, 50);
}

TEST(OrbExtractor, SpreadsOverStrongAndWeakTexture) {
  cv::Mat image = RectangleImage(640, 480, 4, 1500);
  cv::Mat right = image.colRange(320, 640);
  right.convertTo(right, CV_8U, 0.25, 96);  // a quarter of the contrast
  const Features features = MustExtract(image, 1000);
  EXPECT_EQ(features.size(), 1000u);
  const auto weak = std::count_if(features.keypoints.begin(), features.keypoints.end(),
                                  [](const Keypoint& keypoint) { return keypoint.x_px >= 320; });
  EXPECT_GE(weak, 300);
  std::vector<int> in_cell(8 * 6, 0);
  for (const Keypoint& keypoint : features.keypoints) {
    ++in_cell[static_cast<int>(keypoint.y_px / 80) * 8 + static_cast<int>(keypoint.x_px / 80)];
  }
  EXPECT_GE(std::count_if(in_cell.begin(), in_cell.end(), [](int n) { return n >= 5; }), 44);
}

TEST(OrbExtractor, GivesWhatWasAskedForInOrder) {
  const cv::Mat image = RectangleImage(640, 480, 6, 3000);
  for (const int count : {1, 10, 500, 1500}) {
    const Features features = MustExtract(image, count);
    EXPECT_EQ(features.size(), static_cast<std::size_t>(count));
    EXPECT_EQ(features.descriptors.size(), features.keypoints.size());
  }
  const Features features = MustExtract(image);
  EXPECT_TRUE(std::is_sorted(features.keypoints.begin(), features.keypoints.end(),
                             [](const Keypoint& a, const Keypoint& b) { return a.octave < b.octave; }));
  for (const Keypoint& keypoint : features.keypoints) {
    EXPECT_GE(keypoint.angle_rad, -std::numbers::pi_v<float>);
    EXPECT_LT(keypoint.angle_rad, std::numbers::pi_v<float>);
    EXPECT_LT(keypoint.octave, 8);
  }
  EXPECT_TRUE(MustExtract(image) == features);
  // A view into a larger image is the same image.
  cv::Mat padded(500, 700, CV_8UC1, cv::Scalar(7));
  image.copyTo(padded(cv::Rect(20, 10, 640, 480)));
  EXPECT_TRUE(MustExtract(padded(cv::Rect(20, 10, 640, 480))) == features);
}

TEST(OrbExtractor, FindsNothingWhereThereIsNothing) {
  EXPECT_EQ(MustExtract(cv::Mat(480, 640, CV_8UC1, cv::Scalar(90))).size(), 0u);
  EXPECT_EQ(MustExtract(cv::Mat(20, 20, CV_8UC1, cv::Scalar(90))).size(), 0u);
  EXPECT_EQ(MustExtract(RectangleImage(36, 400, 1)).keypoints.size(), MustExtract(RectangleImage(36, 400, 1)).size());
}

TEST(OrbExtractor, RejectsBadInput) {
  const OrbExtractor extractor{OrbParameters{}};
  EXPECT_EQ(extractor.Extract(cv::Mat()).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(extractor.Extract(cv::Mat(100, 100, CV_8UC3)).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(extractor.Extract(cv::Mat(100, 100, CV_32FC1)).status().code(), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(extractor.Extract(cv::Mat(100, 100, CV_8UC1), -1).status().code(), absl::StatusCode::kInvalidArgument);
  const auto with = [](auto change) {
    OrbParameters parameters;
    change(parameters);
    return OrbExtractor(parameters).Extract(cv::Mat(100, 100, CV_8UC1, cv::Scalar(0))).status().code();
  };
  EXPECT_EQ(with([](auto& p) { p.num_features = 0; }), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(with([](auto& p) { p.num_levels = 0; }), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(with([](auto& p) { p.scale_factor = 1.0; }), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(with([](auto& p) { p.scale_factor = std::nan(""); }), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(with([](auto& p) { p.min_fast_threshold = 30; }), absl::StatusCode::kInvalidArgument);
  EXPECT_EQ(with([](auto& p) { p.fast_threshold = 255; }), absl::StatusCode::kInvalidArgument);
}

}  // namespace
}  // namespace cairn::image
