// Turns raw images of a distorted camera into images of an ideal pinhole camera, of the size at which everything after
// it works. That is the raw size, but for large images, which are averaged to kMaxWorkingPixels (no lens resolves more
// along with its blur), and for small ones, which are enlarged to kWorkingPixels: what is counted in pixels from here
// on (search radii, noise, corners that are followed) is then the same share of any image. A rendered office of
// 160x120, 320x240, 640x480 and 1920x1080 px at 15 Hz is mapped with errors of 28, 12, 3.4 and 2.2 mm otherwise.
//
// The pinhole is chosen so that every output pixel lies inside the raw image (no black borders): the largest rectangle
// of the z = 1 plane that the unprojected border of the raw image encloses, cut off at `max_half_angle_deg` from the
// optical axis, is shown at the smallest magnification at which the ratio fx / fy stays that of the raw camera; where
// the rectangle is wider or higher than needed, the view is moved in it as little as possible from the raw principal
// point.
#pragma once

#include <opencv2/core.hpp>
#include <optional>

#include "base/status.h"
#include "geometry/camera.h"
#include "geometry/pinhole.h"

namespace cairn::image {

inline constexpr int kMaxWorkingPixels = 480'000;  // 800x600, or 924x520
inline constexpr int kMinWorkingPixels = 100'000;  // 365x274; less is enlarged to ...
inline constexpr int kWorkingPixels = 307'200;     // ... 640x480, by a factor of 4 at most

struct UndistortOptions {
  // The output never shows more than this to the left, right, top or bottom of the optical axis: the edges of a wide
  // lens would otherwise be stretched without limit. Degrees, in (0, 85].
  double max_half_angle_deg = 60.0;
  // The output camera, if it is not to be chosen: any size; pixels outside the raw image are black then.
  std::optional<Pinhole> target;

  absl::Status Validate() const;
};

class Undistorter {
 public:
  // InvalidArgument for an invalid camera or options; FailedPrecondition if no pinhole view fits into the camera's
  // image.
  static absl::StatusOr<Undistorter> Create(const Camera& camera, const UndistortOptions& options = {});

  const Camera& camera() const { return camera_; }     // of the raw images
  const Pinhole& pinhole() const { return pinhole_; }  // of the undistorted ones
  // True if the camera is a pinhole already, and of a size to work at: images pass through untouched and uncopied.
  bool identity() const { return map_xy_.empty() && !resizes(); }

  // Any number of channels, 8-bit or float, bilinear in 1/32 px. InvalidArgument, naming both sizes, if the image does
  // not have the camera's. Safe from several threads at once.
  absl::StatusOr<cv::Mat> Undistort(const cv::Mat& raw) const;

  // Where a raw pixel comes to lie in the undistorted image, and back; nothing where the model has no answer.
  std::optional<Eigen::Vector2d> PinholeFromRaw(const Eigen::Vector2d& raw_px) const;
  std::optional<Eigen::Vector2d> RawFromPinhole(const Eigen::Vector2d& pinhole_px) const;

 private:
  Undistorter() = default;
  bool resizes() const { return working_.width_px != camera_.width_px || working_.height_px != camera_.height_px; }
  absl::StatusOr<cv::Mat> Resampled(const cv::Mat& image) const;
  void MakeMaps();

  Camera camera_;
  Camera working_;  // of the raw images once they are of a size to work at
  Pinhole pinhole_;
  cv::Mat map_xy_;        // CV_16SC2, and
  cv::Mat map_fraction_;  // CV_16UC1: the fixed-point maps of cv::convertMaps, from the resized image; empty: as it is
};

}  // namespace cairn::image
