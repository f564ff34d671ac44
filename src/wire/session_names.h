// How sessions are named in messages.
#pragma once

#include <cairn/v1/maps.pb.h>

#include "map/entities.h"

namespace cairn::wire {

v1::SessionInfo::Policy Write(map::SessionPolicy policy);
v1::SessionInfo::Result Write(map::SessionResult result);
map::SessionResult ReadResult(v1::SessionInfo::Result result);

}  // namespace cairn::wire
