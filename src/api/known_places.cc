#include "api/known_places.h"

#include <cmath>

namespace cairn::api {

absl::Status KnownPlaces::Validate() const {
  const auto bad = [](const char* what) { return absl::InvalidArgumentError(absl::StrCat("align: ", what)); };
  const bool turns = gravity || upright_cameras;
  if (positions.empty() && distances.empty() && !turns) return bad("nothing is known that it could be aligned by");
  if (!positions.empty() && (!distances.empty() || turns)) {
    return bad("positions say all: neither distances nor gravity go with them");
  }
  if (!positions.empty() && positions.size() < 3) return bad("three known positions at least are needed");
  if (gravity && (upright_cameras || !gravity->allFinite() || !(gravity->norm() > 1e-9))) {
    return bad("gravity is a direction, or that of the cameras");
  }
  for (const KnownPosition& position : positions) {
    // Beyond the earth's diameter something is in other units, or broken.
    if (!position.world_m.allFinite() || !(position.world_m.norm() <= 2e7)) {
      return bad("known positions are metres, at most 20000 km from the world's origin");
    }
  }
  for (const KnownDistance& distance : distances) {
    if (!(distance.metres >= 1e-4 && distance.metres <= 1e6)) {
      return bad("known distances are metres, from 0.0001 to 1000000");
    }
  }
  return absl::OkStatus();
}

}  // namespace cairn::api
