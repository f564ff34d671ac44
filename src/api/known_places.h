// What somebody has measured of the places of a map: positions of some of its points or cameras, distances between
// them, the direction of gravity. A few numbers that a person has read off.
#pragma once

#include <optional>
#include <variant>
#include <vector>

#include "base/ids.h"
#include "base/status.h"
#include "geometry/se3.h"

namespace cairn::api {

// The point that a keyframe sees nearest to a pixel of its undistorted image.
struct SeenAt {
  KeyframeId keyframe;
  Vector2d pixel = Vector2d::Zero();
};
// A point, the camera of a keyframe, or what is seen at a pixel.
using Landmark = std::variant<PointId, KeyframeId, SeenAt>;

struct KnownPosition {
  Landmark of;
  Vector3d world_m = Vector3d::Zero();
};
struct KnownDistance {
  Landmark from, to;
  double metres = 0.0;
};

struct KnownPlaces {
  // Three at least, not on a line; or none, and then:
  std::vector<KnownPosition> positions;
  std::vector<KnownDistance> distances;  // give the scale, by the mean of what each says
  // Give which way is up, which becomes the world's z axis: gravity in the frame of the component (of the world, if it
  // is aligned), or against where the cameras' images are upright on average.
  std::optional<Vector3d> gravity;
  bool upright_cameras = false;

  absl::Status Validate() const;
};

}  // namespace cairn::api
