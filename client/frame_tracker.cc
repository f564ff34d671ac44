#include "client/frame_tracker.h"

#include <algorithm>

namespace cairn::client {

bool LostClock::Lost(TimeNs time_ns) {
  if (!since_ns_) since_ns_ = next_ns_ = time_ns;
  if (time_ns < next_ns_) return false;
  next_ns_ = time_ns + FromSeconds(std::min(kMostApartS, kEvery * ToSeconds(time_ns - *since_ns_)));
  return true;
}

std::optional<Anchor> MoveAnchor(const Anchor& anchor, const map::Snapshot& before, const map::Snapshot& after,
                                 double* unit_ratio) {
  std::optional<Place> place = anchor.place.In(before, after, unit_ratio);
  if (!place) return std::nullopt;
  Anchor moved = anchor;
  // Of an increment in the camera's own frame, which only changes its unit, to the left increment there.
  Vector6d units;
  units << Vector3d::Constant(*unit_ratio), Vector3d::Ones();
  const Matrix6d there =
      place->map_from_camera.Adjoint() * units.asDiagonal() * anchor.place.map_from_camera.Inverse().Adjoint();
  moved.covariance = there * anchor.covariance * there.transpose();
  moved.odometer.way *= *unit_ratio;
  moved.place = *std::move(place);
  return moved;
}

}  // namespace cairn::client
