// Whether a calibration is one that a lens can have. Numbers of another unit (millimetres, shares of the image), of
// another image (a principal point far off) or mistyped ones track every frame and are wrong by metres.
#pragma once

#include <string>

#include "base/status.h"
#include "geometry/camera.h"

namespace cairn {

// InvalidArgument for what no lens is, with what it probably is and the remedy. Sizes and counts are valid already
// (Camera::Validate(), which asks this, too).
absl::Status CheckLens(const Camera& camera);

// What a lens rarely is, for people: not refused, but to be looked at if poses are bad. Empty: nothing.
std::string UnusualLens(const Camera& camera);

}  // namespace cairn
