// What is told to those who watch a server, on the wire: as wire/convert.h.
#pragma once

#include <cairn/v1/sessions.pb.h>
#include <cairn/v1/status.pb.h>

#include "api/active_session.h"
#include "api/server_status.h"

namespace cairn::wire {

void ToProto(const api::ActiveSession& session, v1::ActiveSession* out);
void ToProto(const api::ServerStatus& status, v1::GetStatusResponse* out);

api::ActiveSession FromProto(const v1::ActiveSession& message);
api::ServerStatus FromProto(const v1::GetStatusResponse& message);

}  // namespace cairn::wire
