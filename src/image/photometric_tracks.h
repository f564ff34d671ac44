// Intensities of the same surface points in the images of a sequence, for photometric calibration: corners are followed
// by KLT on images freed of brightness (each pixel less its neighbourhood's mean, over its deviation), so that changes
// of exposure and the vignette do not lose them. Beside each corner the flattest spot on its dark and the flattest on
// its bright side are sampled: there a small error of the track costs no intensity.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "base/status.h"

namespace cairn::image {

struct PhotometricTrackOptions {
  int max_corners = 250;          // followed at a time
  double min_distance_px = 20.0;  // between new corners and those followed
  double max_backward_px = 0.5;   // of a corner followed to the next image and back
  double min_correlation = 0.85;  // of the corner's neighbourhood with that at its last sampling
  int max_samples = 60;           // of one point; a corner is followed no longer than that
  double noise_gray = 1.5;        // standard deviation of a sample
  double position_px = 0.3;       // uncertainty of the position, which costs intensity where there is a gradient

  absl::Status Validate() const;
};

struct PhotometricSample {
  int point = 0;
  int frame = 0;           // counts the sampled images from 0
  double radius = 0.0;     // from the centre of the image; 1 at its corners
  double intensity = 0.0;  // raw, mean of 3 x 3 px
  double sigma_gray = 1.0;
};

class PhotometricTracker {
 public:
  explicit PhotometricTracker(const PhotometricTrackOptions& options = {}) : options_(options) {}

  // The next image of the sequence, raw CV_8UC1, all of one size; InvalidArgument otherwise. `sample`: take intensities
  // from it. Images between samples only help to follow.
  absl::Status Add(const cv::Mat& gray, bool sample);

  const std::vector<PhotometricSample>& samples() const { return samples_; }
  int frames() const { return frames_; }  // sampled
  int points() const { return points_; }
  // Median over all corners ever followed and lost of how far they came across the image, as a share of its diagonal.
  double MedianPath() const;

 private:
  struct Corner {
    cv::Point2f at;
    cv::Point2f born;
    cv::Point2f spot[2];  // relative to `at`
    int point[2] = {-1, -1};
    int samples = 0;
    cv::Mat patch;  // of the normalized image
  };

  void Follow(const cv::Mat& normalized);
  void Replenish(const cv::Mat& gray, const cv::Mat& normalized);
  void Sample(const cv::Mat& gray, const cv::Mat& normalized);
  bool FindSpots(const cv::Mat& smooth, Corner* corner);
  void Drop(const Corner& corner);

  PhotometricTrackOptions options_;
  std::vector<cv::Mat> last_;  // pyramid of the normalized image
  std::vector<Corner> corners_;
  std::vector<PhotometricSample> samples_;
  std::vector<float> paths_;
  cv::Size size_;
  int frames_ = 0;
  int points_ = 0;
};

}  // namespace cairn::image
