// Sessions in messages, and how their kinds are named there.
#pragma once

#include <cairn/v1/maps.pb.h>

#include "map/entities.h"

namespace cairn::wire {

v1::SessionInfo::Policy Write(map::SessionPolicy policy);
v1::SessionInfo::Result Write(map::SessionResult result);
map::SessionResult ReadResult(v1::SessionInfo::Result result);

// All but loops, settings and the reported trajectory.
void Write(const map::Session& session, v1::SessionInfo* out);
map::Session Read(const v1::SessionInfo& message);

}  // namespace cairn::wire
