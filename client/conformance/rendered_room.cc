#include "client/conformance/rendered_room.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "base/random.h"

namespace cairn::conformance {
namespace {

constexpr double kHalf[3] = {3.0, 1.5, 2.5};
constexpr double kPixelsPerUnit = 120.0;

// Rectangles and discs of all sizes, one over the other.
cv::Mat RandomShapes(int width, int height, Random& random) {
  cv::Mat texture(height, width, CV_8UC1, cv::Scalar(128));
  for (int i = 0; i < 1500; ++i) {
    const int size = static_cast<int>(4.0 * std::pow(20.0, random.Uniform()) * (i < 150 ? 3 : 1));
    const cv::Point at(static_cast<int>(random.Below(static_cast<std::uint64_t>(width))),
                       static_cast<int>(random.Below(static_cast<std::uint64_t>(height))));
    const cv::Scalar brightness(random.Uniform(10, 245));
    if (random.Below(3) == 0) {
      cv::circle(texture, at, size / 2 + 1, brightness, cv::FILLED);
    } else {
      const int other = static_cast<int>(size * random.Uniform(0.4, 2.0)) + 2;
      cv::rectangle(texture, cv::Rect(at.x, at.y, size, other), brightness, cv::FILLED);
    }
  }
  cv::GaussianBlur(texture, texture, {}, 0.8);
  return texture;
}

}  // namespace

RenderedRoom::RenderedRoom(std::uint64_t seed) {
  Random random(seed);
  for (int wall = 0; wall < 6; ++wall) {
    const int axis = wall / 2;
    const int u = axis == 0 ? 2 : 0, v = axis == 1 ? 2 : 1;
    textures_[wall] = RandomShapes(static_cast<int>(2 * kHalf[u] * kPixelsPerUnit),
                                   static_cast<int>(2 * kHalf[v] * kPixelsPerUnit), random);
  }
}

Vector3d RenderedRoom::Hit(const Vector3d& center, const Vector3d& direction) {
  double nearest = std::numeric_limits<double>::max();
  for (int axis = 0; axis < 3; ++axis) {
    if (std::abs(direction[axis]) < 1e-12) continue;
    const double wall = direction[axis] > 0 ? kHalf[axis] : -kHalf[axis];
    nearest = std::min(nearest, (wall - center[axis]) / direction[axis]);
  }
  return center + nearest * direction;
}

double RenderedRoom::Brightness(const Vector3d& center, const Vector3d& direction) const {
  const Vector3d hit = Hit(center, direction);
  int axis = 0;
  for (int k = 1; k < 3; ++k) {
    if (kHalf[k] - std::abs(hit[k]) < kHalf[axis] - std::abs(hit[axis])) axis = k;
  }
  const cv::Mat& texture = textures_[2 * axis + (hit[axis] > 0 ? 1 : 0)];
  const int u = axis == 0 ? 2 : 0, v = axis == 1 ? 2 : 1;
  const double x = std::clamp((hit[u] + kHalf[u]) * kPixelsPerUnit, 0.0, texture.cols - 1.001);
  const double y = std::clamp((hit[v] + kHalf[v]) * kPixelsPerUnit, 0.0, texture.rows - 1.001);
  const int ix = static_cast<int>(x), iy = static_cast<int>(y);
  const double fx = x - ix, fy = y - iy;
  return (1 - fy) * ((1 - fx) * texture.at<std::uint8_t>(iy, ix) + fx * texture.at<std::uint8_t>(iy, ix + 1)) +
         fy * ((1 - fx) * texture.at<std::uint8_t>(iy + 1, ix) + fx * texture.at<std::uint8_t>(iy + 1, ix + 1));
}

cv::Mat RenderedRoom::Render(const Pinhole& pinhole, const SE3& camera_from_room) const {
  return Render(Camera::FromPinhole(pinhole), camera_from_room);
}

cv::Mat RenderedRoom::Render(const Camera& camera, const SE3& camera_from_room) const {
  const SE3 room_from_camera = camera_from_room.Inverse();
  const Matrix3d rotation = room_from_camera.RotationMatrix();
  cv::Mat image(camera.height_px, camera.width_px, CV_8UC1, cv::Scalar(0));
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const auto ray = camera.Unproject(Vector2d(x, y));
      if (!ray) continue;
      image.at<std::uint8_t>(y, x) =
          cv::saturate_cast<std::uint8_t>(Brightness(room_from_camera.translation(), rotation * *ray));
    }
  }
  return image;
}

}  // namespace cairn::conformance
