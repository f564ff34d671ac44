// Sessions in messages, and how their kinds are named there.
#pragma once

#include <cairn/v1/maps.pb.h>
#include <cairn/v1/sessions.pb.h>

#include "api/map_session.h"
#include "map/entities.h"

namespace cairn::wire {

v1::SessionInfo::Policy Write(map::SessionPolicy policy);
v1::SessionInfo::Result Write(map::SessionResult result);
v1::FrameAnswer::State Write(api::SessionState state);
// Lost for one that is not known.
api::SessionState ReadState(v1::FrameAnswer::State state);
map::SessionResult ReadResult(v1::SessionInfo::Result result);

// All but loops, settings and the reported trajectory.
void Write(const map::Session& session, v1::SessionInfo* out);
map::Session Read(const v1::SessionInfo& message);

}  // namespace cairn::wire
