// How well the map knows its points: what their observations leave open, the keyframes' poses taken as right. A point
// that was seen from one side only is known well across the rays and badly along them; from where the keyframes stood
// that does not show, from aside it does.
#pragma once

#include "geometry/pinhole.h"
#include "geometry/se3.h"
#include "map/snapshot.h"

namespace cairn::tracking {

// Standard deviation per axis, in pixels of full resolution, of where the point appears in a camera at `centre` (in
// the map frame), for what its position leaves open: first order, of the triangulation from all observations
// with half a pixel of the level of the reference observation each (Hartley, Zisserman, "Multiple view geometry", 2003,
// Sec. 5.2). At most `max_px`.
double ProjectedSigma(const map::Snapshot& map, const map::MapPoint& point, const Vector3d& centre, double focal_px,
                      double max_px);

}  // namespace cairn::tracking
