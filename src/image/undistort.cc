#include "image/undistort.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "base/cpu_features.h"
#include "base/guarded.h"
#include "image/undistort_kernel.h"

namespace cairn::image {
namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr double kDegree = 3.14159265358979323846 / 180.0;

// An upright rectangle of the plane z = 1.
struct Rectangle {
  double left, right, top, bottom;

  void Shrink(double factor) { left *= factor, right *= factor, top *= factor, bottom *= factor; }
};

// The largest rectangle inside the unprojected border of the raw image. Border pixels that see beyond `limit` bind
// nothing.
Rectangle InsideOfBorder(const Camera& camera, double limit) {
  Rectangle r{-limit, limit, -limit, limit};
  const auto plane = [&](double x, double y) -> std::optional<Vector2d> {
    const std::optional<Vector3d> ray = camera.Unproject({x, y});
    if (!ray || ray->z() <= 0.0) return std::nullopt;
    return Vector2d(ray->head<2>() / ray->z());
  };
  const int right = camera.width_px - 1, bottom = camera.height_px - 1;
  for (int y = 0; y <= bottom; ++y) {
    if (const auto p = plane(0, y)) r.left = std::max(r.left, p->x());
    if (const auto p = plane(right, y)) r.right = std::min(r.right, p->x());
  }
  for (int x = 0; x <= right; ++x) {
    if (const auto p = plane(x, 0)) r.top = std::max(r.top, p->y());
    if (const auto p = plane(x, bottom)) r.bottom = std::min(r.bottom, p->y());
  }
  return r;
}

// The view of the rectangle: square pixels stay as square as the raw camera's, see the header.
Pinhole ViewOf(const Rectangle& r, const Camera& camera) {
  const double width = camera.width_px - 1, height = camera.height_px - 1;
  const double zoom =
      std::max(width / ((r.right - r.left) * camera.fx_px), height / ((r.bottom - r.top) * camera.fy_px));
  Pinhole view = camera.Intrinsics();
  view.fx_px *= zoom;
  view.fy_px *= zoom;
  // The pixel of the axis may be anywhere from where the right end fits to where the left end fits.
  view.cx_px =
      std::clamp(camera.cx_px, std::min(width - r.right * view.fx_px, -r.left * view.fx_px), -r.left * view.fx_px);
  view.cy_px =
      std::clamp(camera.cy_px, std::min(height - r.bottom * view.fy_px, -r.top * view.fy_px), -r.top * view.fy_px);
  return view;
}

// Whether every border pixel of the view comes from inside the raw image; with the border, all.
bool LiesInside(const Pinhole& view, const Camera& camera) {
  const auto inside = [&](double x, double y) {
    const std::optional<Vector2d> raw = camera.Project(view.Unproject({x, y}));
    return raw && camera.Contains(*raw);
  };
  const int right = view.width_px - 1, bottom = view.height_px - 1;
  for (int x = 0; x <= right; ++x) {
    if (!inside(x, 0) || !inside(x, bottom)) return false;
  }
  for (int y = 0; y <= bottom; ++y) {
    if (!inside(0, y) || !inside(right, y)) return false;
  }
  return true;
}

// `given`: the camera as the caller knows it, for the message.
absl::StatusOr<Pinhole> ChooseView(const Camera& camera, double max_half_angle_deg, const Camera& given) {
  // Of the view that the focal length alone would give: no lens takes away more. Distortions that make no sense leave a
  // few pixels, of which nothing can be made.
  constexpr double kLeastShare = 0.1;
  Rectangle r = InsideOfBorder(camera, std::tan(max_half_angle_deg * kDegree));
  const bool wide = r.right - r.left > kLeastShare * camera.width_px / camera.fx_px &&
                    r.bottom - r.top > kLeastShare * camera.height_px / camera.fy_px;
  if (wide && r.left < 0 && r.right > 0 && r.top < 0 && r.bottom > 0 && camera.width_px > 1 && camera.height_px > 1) {
    for (int i = 0; i < 500; ++i) {
      const Pinhole view = ViewOf(r, camera);
      if (LiesInside(view, camera)) return view;
      r.Shrink(i == 0 ? 1.0 - 1e-6 : 0.995);  // at first for rounding alone
    }
  }
  return absl::InvalidArgumentError(absl::StrCat("no undistorted view without black borders fits into the camera (",
                                                 given.Describe(), "); check its calibration"));
}

// The same camera with its image brought to a size to work at. Centres of pixels are at integers.
Camera AtWorkingSize(const Camera& camera) {
  constexpr double kMaxEnlargement = 4.0;
  const double pixels = static_cast<double>(camera.width_px) * camera.height_px;
  double scale = 1.0;
  if (pixels > kMaxWorkingPixels) scale = std::sqrt(kMaxWorkingPixels / pixels);
  if (pixels < kMinWorkingPixels) scale = std::min(std::sqrt(kWorkingPixels / pixels), kMaxEnlargement);
  if (scale == 1.0) return camera;
  Camera working = camera;
  working.width_px = std::max(1, static_cast<int>(camera.width_px * scale));
  working.height_px = std::max(1, static_cast<int>(camera.height_px * scale));
  const double x = static_cast<double>(working.width_px) / camera.width_px;
  const double y = static_cast<double>(working.height_px) / camera.height_px;
  working.fx_px *= x;
  working.fy_px *= y;
  working.cx_px = (camera.cx_px + 0.5) * x - 0.5;
  working.cy_px = (camera.cy_px + 0.5) * y - 0.5;
  return working;
}

template <class T, class Kernel>
void Resample(const cv::Mat& raw, const cv::Mat& map_xy, const cv::Mat& map_fraction, Kernel kernel, cv::Mat* out) {
  out->create(map_xy.size(), raw.type());
  const RawImage<T> image = {raw.ptr<T>(), static_cast<std::ptrdiff_t>(raw.step1()), raw.cols, raw.rows};
  for (int y = 0; y < out->rows; ++y) {
    kernel(image, map_xy.ptr<std::int16_t>(y), map_fraction.ptr<std::uint16_t>(y), out->cols, out->ptr<T>(y));
  }
}

}  // namespace

absl::Status UndistortOptions::Validate() const {
  if (!(max_half_angle_deg > 0.0 && max_half_angle_deg <= 85.0)) {
    return absl::InvalidArgumentError(
        absl::StrCat("max_half_angle_deg is ", max_half_angle_deg, " but must be in (0, 85]"));
  }
  if (target) return Annotate(Camera::FromPinhole(*target).Validate(), "camera of the undistorted images");
  return absl::OkStatus();
}

absl::StatusOr<Undistorter> Undistorter::Create(const Camera& camera, const UndistortOptions& options) {
  CAIRN_RETURN_IF_ERROR(camera.Validate());
  CAIRN_RETURN_IF_ERROR(options.Validate());
  Undistorter out;
  out.camera_ = camera;
  out.working_ = options.target ? camera : AtWorkingSize(camera);
  if (camera.IsUndistorted() && (!options.target || *options.target == camera.Intrinsics())) {
    out.pinhole_ = out.working_.Intrinsics();
    return out;
  }
  if (options.target) {
    out.pinhole_ = *options.target;
  } else {
    CAIRN_ASSIGN_OR_RETURN(out.pinhole_, ChooseView(out.working_, options.max_half_angle_deg, camera));
  }
  return Guarded([&]() -> absl::StatusOr<Undistorter> {
    out.MakeMaps();
    return out;
  });
}

// Row by row: the maps of large images take hundreds of megabytes, and need not be there in two forms.
void Undistorter::MakeMaps() {
  const int width = pinhole_.width_px, height = pinhole_.height_px;
  map_xy_.create(height, width, CV_16SC2);
  map_fraction_.create(height, width, CV_16UC1);
  cv::Mat map_x(1, width, CV_32FC1), map_y(1, width, CV_32FC1);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const std::optional<Vector2d> raw = working_.Project(pinhole_.Unproject(Vector2d(x, y)));
      const bool inside = raw && working_.Contains(*raw, -1.0);
      map_x.at<float>(0, x) = inside ? static_cast<float>(raw->x()) : -2.0f;  // outside: black
      map_y.at<float>(0, x) = inside ? static_cast<float>(raw->y()) : -2.0f;
    }
    cv::Mat xy = map_xy_.row(y), fraction = map_fraction_.row(y);
    cv::convertMaps(map_x, map_y, xy, fraction, CV_16SC2, false);
  }
}

absl::StatusOr<cv::Mat> Undistorter::Undistort(const cv::Mat& raw) const {
  if (raw.cols != camera_.width_px || raw.rows != camera_.height_px) {
    return absl::InvalidArgumentError(absl::StrCat("the image has ", raw.cols, "x", raw.rows, " px but its camera ",
                                                   camera_.width_px, "x", camera_.height_px,
                                                   " px; use the calibration of this image size"));
  }
  if (!resizes()) return Resampled(raw);
  cv::Mat resized;
  try {
    const bool larger = working_.width_px > camera_.width_px;
    cv::resize(raw, resized, {working_.width_px, working_.height_px}, 0, 0, larger ? cv::INTER_CUBIC : cv::INTER_AREA);
  } catch (const cv::Exception& error) {
    return absl::InvalidArgumentError(absl::StrCat("resizing an image: ", error.what()));
  }
  return Resampled(resized);
}

absl::StatusOr<cv::Mat> Undistorter::Resampled(const cv::Mat& raw) const {
  if (map_xy_.empty()) return raw;
  cv::Mat out;
  const UndistortKernels& kernels = UndistortKernelsFor(ActiveSimdLevel());
  if (raw.type() == CV_8UC1) {
    Resample<std::uint8_t>(raw, map_xy_, map_fraction_, kernels.bytes, &out);
    return out;
  }
  if (raw.type() == CV_32FC1) {
    Resample<float>(raw, map_xy_, map_fraction_, kernels.floats, &out);
    return out;
  }
  try {
    cv::remap(raw, out, map_xy_, map_fraction_, cv::INTER_LINEAR, cv::BORDER_CONSTANT, cv::Scalar());
  } catch (const cv::Exception& error) {
    return absl::InvalidArgumentError(absl::StrCat("undistorting an image: ", error.what()));
  }
  return out;
}

std::optional<Vector2d> Undistorter::PinholeFromRaw(const Vector2d& raw_px) const {
  const std::optional<Vector3d> ray = camera_.Unproject(raw_px);
  if (!ray || ray->z() <= 0.0) return std::nullopt;
  return pinhole_.Project(*ray);
}

std::optional<Vector2d> Undistorter::RawFromPinhole(const Vector2d& pinhole_px) const {
  return camera_.Project(pinhole_.Unproject(pinhole_px));
}

}  // namespace cairn::image
