#include "image/orb_extractor.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "image/orb_detection.h"

namespace cairn::image {
namespace {

constexpr float kDegreesPerRad = 180.0f / std::numbers::pi_v<float>;

Descriptor FromBytes(const std::uint8_t* bytes) {
  Descriptor descriptor;
  std::memcpy(descriptor.data(), bytes, sizeof(descriptor));
  if constexpr (std::endian::native == std::endian::big) {
    for (std::uint64_t& word : descriptor) word = __builtin_bswap64(word);
  }
  return descriptor;
}

// Each level from the one before; empty levels end the pyramid.
std::vector<cv::Mat> BuildLevels(const cv::Mat& gray, const OrbParameters& parameters) {
  // OpenCV's filters look at what surrounds a view into a larger image; the answer must not depend on it.
  std::vector<cv::Mat> levels = {gray.isSubmatrix() ? gray.clone() : gray};
  for (int octave = 1; octave < parameters.num_levels; ++octave) {
    const double scale = parameters.Scale(octave);
    const cv::Size size(static_cast<int>(std::lround(gray.cols / scale)),
                        static_cast<int>(std::lround(gray.rows / scale)));
    if (size.width <= 2 * internal::kOrbBorderPx || size.height <= 2 * internal::kOrbBorderPx) break;
    cv::Mat level;
    cv::resize(levels.back(), level, size, 0, 0, cv::INTER_LINEAR);
    levels.push_back(std::move(level));
  }
  return levels;
}

// Appends the features of one level. OpenCV blurs the level and compares the pairs of its learned pattern.
absl::Status DescribeLevel(const cv::Mat& level, const std::vector<internal::Corner>& corners, cv::Size full,
                           int octave, Features* features) {
  if (corners.empty()) return absl::OkStatus();
  std::vector<cv::KeyPoint> points;
  points.reserve(corners.size());
  for (const internal::Corner& corner : corners) {
    const float angle_rad = internal::Orientation(level, corner);
    const cv::Point2f refined = internal::RefineCorner(level, corner);
    // Pixel centres are at integer coordinates: the corner of the image is at -0.5 on every level.
    Keypoint keypoint;
    keypoint.x_px =
        KeptPosition((refined.x + 0.5f) * (static_cast<float>(full.width) / static_cast<float>(level.cols)) - 0.5f);
    keypoint.y_px =
        KeptPosition((refined.y + 0.5f) * (static_cast<float>(full.height) / static_cast<float>(level.rows)) - 0.5f);
    keypoint.angle_rad = angle_rad;
    keypoint.octave = static_cast<std::uint8_t>(octave);
    features->keypoints.push_back(keypoint);
    points.emplace_back(static_cast<float>(corner.x), static_cast<float>(corner.y), 31.0f, angle_rad * kDegreesPerRad,
                        static_cast<float>(corner.score), 0, -1);
  }
  const cv::Ptr<cv::ORB> orb = cv::ORB::create(static_cast<int>(points.size()), 1.2f, 1, internal::kOrbBorderPx);
  cv::Mat descriptors;
  orb->compute(level, points, descriptors);
  if (descriptors.rows != static_cast<int>(corners.size()) || descriptors.cols != 32) {
    return absl::InternalError(absl::StrCat("OpenCV's ORB described ", descriptors.rows, " of ", corners.size(),
                                            " keypoints on octave ", octave));
  }
  for (int i = 0; i < descriptors.rows; ++i) features->descriptors.push_back(FromBytes(descriptors.ptr(i)));
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Features> OrbExtractor::Extract(const cv::Mat& gray, int num_features) const {
  CAIRN_RETURN_IF_ERROR(parameters_.Validate());
  if (gray.empty()) return absl::InvalidArgumentError("ORB extraction was given an empty image");
  if (gray.type() != CV_8UC1) {
    return absl::InvalidArgumentError(absl::StrCat(
        "ORB extraction needs an 8-bit grey image (CV_8UC1), not OpenCV type ", gray.type(), "; convert it first"));
  }
  if (gray.cols > 32767 || gray.rows > 32767) {
    return absl::InvalidArgumentError(
        absl::StrCat("ORB extraction takes images up to 32767 px, not ", gray.cols, "x", gray.rows));
  }
  if (num_features < 0) {
    return absl::InvalidArgumentError(absl::StrCat("ORB extraction was asked for ", num_features, " features"));
  }
  int remaining = num_features > 0 ? num_features : parameters_.num_features;
  Features features;
  if (gray.cols <= 2 * internal::kOrbBorderPx || gray.rows <= 2 * internal::kOrbBorderPx) return features;
  features.keypoints.reserve(remaining);
  features.descriptors.reserve(remaining);
  try {
    const std::vector<cv::Mat> levels = BuildLevels(gray, parameters_);
    // Shares fall with the scale. What a coarse level cannot fill goes to the finer ones.
    std::vector<std::vector<internal::Corner>> corners(levels.size());
    std::vector<double> share_up_to(levels.size());
    double sum = 0.0;
    for (std::size_t i = 0; i < levels.size(); ++i) {
      sum += 1.0 / parameters_.Scale(static_cast<int>(i));
      share_up_to[i] = sum;
    }
    for (int i = static_cast<int>(levels.size()) - 1; i >= 0; --i) {
      const double share = 1.0 / parameters_.Scale(i) / share_up_to[i];
      const int count = i == 0 ? remaining : static_cast<int>(std::lround(remaining * share));
      corners[i] = internal::SpreadCorners(
          internal::DetectCorners(levels[i], parameters_.fast_threshold, parameters_.min_fast_threshold), count,
          levels[i].size());
      remaining -= static_cast<int>(corners[i].size());
    }
    for (std::size_t i = 0; i < levels.size(); ++i) {
      CAIRN_RETURN_IF_ERROR(DescribeLevel(levels[i], corners[i], gray.size(), static_cast<int>(i), &features));
    }
  } catch (const cv::Exception& error) {
    return absl::InternalError(absl::StrCat("OpenCV failed in ORB extraction: ", error.what()));
  }
  return features;
}

}  // namespace cairn::image
