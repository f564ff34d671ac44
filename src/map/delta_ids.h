// The ids of what a delta puts and removes.
#pragma once

#include <memory>

#include "map/entities.h"

namespace cairn::map {

inline KeyframeId IdOf(KeyframeId id) { return id; }
inline PointId IdOf(PointId id) { return id; }
inline CameraId IdOf(CameraId id) { return id; }
inline ComponentId IdOf(ComponentId id) { return id; }
inline CameraId IdOf(const MapCamera& camera) { return camera.id; }
inline SessionId IdOf(const Session& session) { return session.id; }
inline ComponentId IdOf(const Component& component) { return component.id; }
// None of what is not there.
inline KeyframeId IdOf(const std::shared_ptr<const Keyframe>& keyframe) {
  return keyframe ? keyframe->id : KeyframeId();
}
inline PointId IdOf(const std::shared_ptr<const MapPoint>& point) { return point ? point->id : PointId(); }

}  // namespace cairn::map
