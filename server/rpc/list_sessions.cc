#include "server/rpc/calls.h"
#include "wire/convert_status.h"

namespace cairn::server {

absl::Status ListSessions(const CallContext& context, const v1::ListSessionsRequest& request,
                          v1::ListSessionsResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<api::ActiveSession> sessions, context.maps->Sessions(request.map()));
  for (const api::ActiveSession& session : sessions) wire::ToProto(session, response->add_sessions());
  return absl::OkStatus();
}

}  // namespace cairn::server
