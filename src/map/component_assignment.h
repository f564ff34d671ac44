// Components for maps of the formats before 4, which had none: after a loss that nothing bridged, mapping went on
// beside what it had, in the same frame by a guess. Each part that nothing links to the others becomes a component.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "map/entities.h"

namespace cairn::map {

// Sets Keyframe::component, cuts the links between different components (guesses), and fills Session::components. What
// links keyframes: shared points, closed loops, the odometry within one of its segments, and given poses, which share a
// frame. The component with most keyframes is 1 and is the one that `world_from_map` was about. The entities are to be
// linked already (parents, children, covisibility). Returns the components, ascending; at least one.
std::vector<Component> AssignComponents(const std::optional<Sim3>& world_from_map,
                                        const std::vector<std::shared_ptr<Keyframe>>& keyframes,
                                        std::vector<Session>* sessions);

}  // namespace cairn::map
