// Whether two calibrations are of one camera.
#pragma once

#include "geometry/camera.h"
#include "geometry/pinhole.h"

namespace cairn::map {

// The same but for rounding: every ray meets the same pixel, however the two say it.
bool SameCalibration(const Camera& a, const Camera& b);
bool SamePinhole(const Pinhole& a, const Pinhole& b);

}  // namespace cairn::map
