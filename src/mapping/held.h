// What a session must not move: keyframes that others have made of a component that is aligned to the world. Its drift
// would carry them off from where people know them to be.
#pragma once

#include "map/edit.h"
#include "map/snapshot.h"

namespace cairn::mapping {

// `session`: whose change it is.
inline bool IsHeld(const map::Snapshot& map, const map::Keyframe& keyframe, SessionId session) {
  return keyframe.session != session && map.WorldFrom(keyframe.component).has_value();
}
inline bool IsHeld(const map::Edit& edit, const map::Keyframe& keyframe, SessionId session) {
  return keyframe.session != session && edit.component(keyframe.component).world_from_component.has_value();
}

}  // namespace cairn::mapping
