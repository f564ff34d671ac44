// The small tables of a map on the wire: what it is, its cameras, sessions and components; as wire/convert.h.
#pragma once

#include <cairn/v1/follow.pb.h>

#include "base/status.h"
#include "map/entities.h"
#include "map/region.h"

namespace cairn::wire {

void ToProto(const map::MapInfo& info, v1::MapHead* out);
void ToProto(const map::MapCamera& camera, v1::CameraRow* out);
void ToProto(const map::Session& session, v1::SessionRow* out);
void ToProto(const map::Component& component, v1::ComponentRow* out);

void ToProto(const map::RegionQuery& region, v1::MapRegion* out);

absl::StatusOr<map::RegionQuery> FromProto(const v1::MapRegion& message);
absl::StatusOr<map::MapInfo> FromProto(const v1::MapHead& message);
absl::StatusOr<map::MapCamera> FromProto(const v1::CameraRow& message);
map::Session FromProto(const v1::SessionRow& message);
absl::StatusOr<map::Component> FromProto(const v1::ComponentRow& message);

}  // namespace cairn::wire
