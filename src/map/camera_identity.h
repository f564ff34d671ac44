// Whether two calibrations are of one camera.
#pragma once

#include "geometry/camera.h"
#include "geometry/pinhole.h"

namespace cairn::map {

// The same but for rounding: every ray meets the same pixel, however the two say it.
bool SameCalibration(const Camera& a, const Camera& b);
// The same but for rounding and for the resolution: one is the other's image, enlarged or reduced as a whole. Whether
// the one who did that counted pixel centres or corners makes a difference of half a pixel, which counts as rounding.
bool SameLens(const Camera& a, const Camera& b);
bool SamePinhole(const Pinhole& a, const Pinhole& b);

}  // namespace cairn::map
