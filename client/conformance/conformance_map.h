// The map that the conformance suite asks about: keyframes in a rendered room, their points at their true places.
#pragma once

#include <string>

#include "base/status.h"
#include "client/conformance/rendered_room.h"
#include "geometry/camera.h"
#include "map/snapshot.h"
#include "place/vocabulary.h"

namespace cairn::conformance {

struct ConformanceMap {
  RenderedRoom room;
  Pinhole pinhole;         // of the keyframes
  std::string vocabulary;  // serialised
  map::Delta delta;        // from the empty map to this one
  std::shared_ptr<const map::Snapshot> snapshot;
};

// Made once per process. world_from_component doubles the scale and moves along x by 10.
const ConformanceMap& TheConformanceMap();

// The same with a second component that looks exactly like the first, 30 further along x in the world.
const ConformanceMap& TheTwinMap();

// Writes it to a new map file.
absl::Status WriteConformanceMap(const std::string& path, const ConformanceMap& map = TheConformanceMap());

// One of another size, focal length and lens than that of the map.
Camera AnotherCamera();

// camera_from_map of a camera at `center` turned to the right by `yaw_rad` from looking along +z.
SE3 LookInRoom(const Vector3d& center, double yaw_rad);

}  // namespace cairn::conformance
