#include "geometry/lens_plausibility.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "absl/strings/str_format.h"

namespace cairn {
namespace {

// Of the longer side. A pinhole image with 0.2 of it shows 136 degrees, one with 20 shows 3.
constexpr double kShortestPerspective = 0.2, kShortestFisheye = 0.1, kLongest = 20.0;
constexpr double kSquarest = 2.5;  // fx against fy; half pictures of interlaced video have 2.2
constexpr double kFarthest = 0.5;  // of the principal point from the middle, in sizes of the image
constexpr double kUnusual = 0.25, kUnusualAspect = 1.3;

bool IsPerspective(const Camera& camera) {
  return camera.model == CameraModel::kPinhole || camera.model == CameraModel::kRadialTangential;
}

double Aspect(const Camera& c) { return std::max(c.fx_px / c.fy_px, c.fy_px / c.fx_px); }

// Distance of the principal point from the middle, each axis as a share of the size.
double Offset(const Camera& c) {
  return std::hypot((c.cx_px + 0.5) / c.width_px - 0.5, (c.cy_px + 0.5) / c.height_px - 0.5);
}

std::string Shown(const Camera& c) {
  return absl::StrFormat("fx %g, fy %g, cx %g, cy %g px of an image of %dx%d", c.fx_px, c.fy_px, c.cx_px, c.cy_px,
                         c.width_px, c.height_px);
}

}  // namespace

absl::Status CheckLens(const Camera& c) {
  const auto refuse = [&](const std::string& why) {
    return absl::InvalidArgumentError(absl::StrCat("no lens has this calibration: ", Shown(c), ": ", why));
  };
  const double longer = std::max(c.width_px, c.height_px), focal = std::min(c.fx_px, c.fy_px);
  const bool relative = c.cx_px > 0.0 && c.cx_px <= 1.0 && c.cy_px > 0.0 && c.cy_px <= 1.0 && c.width_px > 8;
  if (relative) {
    return refuse(absl::StrFormat("these are shares of the image; in pixels: fx %.6g, fy %.6g, cx %.6g, cy %.6g",
                                  c.fx_px * c.width_px, c.fy_px * c.height_px, c.cx_px * c.width_px - 0.5,
                                  c.cy_px * c.height_px - 0.5));
  }
  if (Aspect(c) > kSquarest) {
    return refuse(absl::StrFormat("fx and fy differ by a factor of %.3g, one of them is wrong", Aspect(c)));
  }
  if (focal < (IsPerspective(c) ? kShortestPerspective : kShortestFisheye) * longer) {
    const double angle_deg = 2.0 * std::atan(0.5 * longer / focal) * 180.0 / std::numbers::pi;
    return refuse(absl::StrFormat(
        "the focal length is too short%s; if it is in millimetres, divide it by the size of a pixel in millimetres",
        IsPerspective(c) ? absl::StrFormat(" (it would show %.0f degrees)", angle_deg) : std::string()));
  }
  if (focal > kLongest * longer) {
    return refuse("the focal length is too long; it is to be in pixels of this image");
  }
  if (Offset(c) > kFarthest) {
    return refuse(
        "the principal point is far from the middle; is the calibration of another image size, or its corner the "
        "origin?");
  }
  return absl::OkStatus();
}

std::string UnusualLens(const Camera& c) {
  std::string what;
  if (Offset(c) > kUnusual) {
    what =
        "the principal point is far from the middle (right for cropped images; else the calibration is of another "
        "size)";
  }
  if (Aspect(c) > kUnusualAspect) {
    absl::StrAppend(&what, what.empty() ? "" : ", and ", "fx and fy differ (right for stretched images)");
  }
  return what.empty() ? "" : absl::StrCat("the calibration is unusual: ", Shown(c), ": ", what);
}

}  // namespace cairn
