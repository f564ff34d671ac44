// Maps as scenes to be drawn (plot/scene_figure.h).
#pragma once

#include <string>
#include <vector>

#include "base/status.h"
#include "map/snapshot.h"
#include "plot/scene_figure.h"

namespace cairn::cli {

// The direction against gravity in the frame in which the components lie: that in which the cameras' images are upright
// on average; an axis of the world if that is near.
Vector3d UpOf(const map::Snapshot& map, const std::vector<ComponentId>& components);

// The unit of inspect::Placed() for components of inspect::TogetherInOneFrame().
const char* UnitOf(const map::Snapshot& map, const std::vector<ComponentId>& components);

// What colours tell.
enum class SceneColors { kSession, kAge, kError, kObservations };

// Cameras and points of the components, in the world where they are aligned to it.
plot::SceneFigure SceneOf(const map::Snapshot& map, const std::vector<ComponentId>& components, SceneColors colors);

// The cameras from above in braille dots, at most `columns` wide: one character has 2 x 4 dots. Lines end with "\n";
// empty without cameras. The first line says how long a line is.
std::string BraillePlan(const map::Snapshot& map, const std::vector<ComponentId>& components, int columns);

}  // namespace cairn::cli
