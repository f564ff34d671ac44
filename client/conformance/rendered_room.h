// Images of a small textured room, for tests that need pixels: seeded, and the same on every machine.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "geometry/camera.h"
#include "geometry/pinhole.h"
#include "geometry/se3.h"

namespace cairn::conformance {

// The camera is inside a box 6 wide (x), 3 high (y), 5 deep (z) around the origin, whose walls are covered with random
// shapes.
class RenderedRoom {
 public:
  explicit RenderedRoom(std::uint64_t seed = 1);

  // CV_8UC1, by one ray per pixel.
  cv::Mat Render(const Pinhole& pinhole, const SE3& camera_from_room) const;
  // The same through a lens with distortion.
  cv::Mat Render(const Camera& camera, const SE3& camera_from_room) const;

  // Where the ray through a pixel ends, in the room's frame.
  static Vector3d Hit(const Vector3d& center, const Vector3d& direction);

 private:
  double Brightness(const Vector3d& center, const Vector3d& direction) const;

  cv::Mat textures_[6];
};

}  // namespace cairn::conformance
