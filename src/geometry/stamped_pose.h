// A pose of a camera at a time.
#pragma once

#include "base/time.h"
#include "geometry/se3.h"

namespace cairn {

struct StampedPose {
  TimeNs time_ns = 0;
  SE3 world_from_camera;
};

}  // namespace cairn
