// Which poses of a map can be written together: those of components whose frames are one.
#pragma once

#include <vector>

#include "api/map_service.h"
#include "base/ids.h"
#include "map/snapshot.h"

namespace cairn::cli {

struct CommonFrame {
  std::vector<ComponentId> components;  // all that are aligned, or else the one with most keyframes
  bool metric = false;                  // their frame is the world
  std::vector<Sim3> common_from;        // of each; the identity unless `metric`
};

CommonFrame CommonFrameOf(const map::Snapshot& map);
CommonFrame CommonFrameOf(const api::MapDescription& map);

}  // namespace cairn::cli
