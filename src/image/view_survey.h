// What of a camera's images is not of the scene, found from samples of a sequence before it is used: what is fixed to
// the camera (a car's bonnet, a mount, an overlay), two half pictures woven into one (interlacing), and bands of light
// that run over the rows (mains flicker under a rolling shutter).
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace cairn::image {

// Waves of brightness over the rows, the same over the whole width.
struct Bands {
  double amplitude = 0.0;  // as a share of the brightness; 0: none
  double periods = 0.0;    // over the height of the image
};

struct ViewSurvey {
  // CV_8UC1 of the images' size: 0 where the view does not move with the scene, else 255. Empty: nowhere.
  cv::Mat mask;
  double fixed_share = 0.0;  // of the view, that is fixed to the camera
  bool interlaced = false;
  Bands bands;  // as is typical between an image and the next
};

// Collects samples, CV_8UC1 of one size, in little memory.
class ViewSurveyor {
 public:
  // An image, and the next one of the sequence, which may be empty. In whatever order.
  void Add(const cv::Mat& image, const cv::Mat& next);
  int count() const { return static_cast<int>(small_.size()); }
  ViewSurvey Result() const;

 private:
  cv::Size size_;
  std::vector<cv::Mat> small_;  // CV_32FC1, local contrast only
  std::vector<double> combs_;
  std::vector<Bands> bands_;
};

// How much more two neighbouring rows differ than every other one: above 1 only where two half pictures of different
// times are woven into one.
double CombStrength(const cv::Mat& image);

// The bands in which the brightness of two images differs; none where the difference looks otherwise.
Bands BandsBetween(const cv::Mat& image, const cv::Mat& next);

// Takes waves of so many periods out of the brightness of an image's rows. What the scene itself has of them goes too,
// but is nearly the same in the next image, and so does no harm to who compares the two.
void EvenOutBands(double periods, cv::Mat* image);

// Replaces the odd rows by the mean of those around them.
void DropSecondField(cv::Mat* image);

// Continues the image smoothly into what a mask (CV_8UC1, 0 there) hides, so that there is nothing to see in it.
class MaskFiller {
 public:
  MaskFiller() = default;
  explicit MaskFiller(const cv::Mat& mask);
  bool empty() const { return mask_.empty(); }
  const cv::Mat& mask() const { return mask_; }
  void Fill(cv::Mat* image) const;

 private:
  cv::Mat mask_;
  cv::Rect around_;  // what is hidden, and a margin
};

}  // namespace cairn::image
