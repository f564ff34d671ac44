#include "server/rpc/calls.h"
#include "wire/convert_admin.h"

namespace cairn::server {

absl::Status RemoveSession(const CallContext& context, const v1::RemoveSessionRequest& request,
                           v1::RemoveSessionResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const api::SessionRemoval removal,
                         context.maps->RemoveSession(request.map(), SessionId(request.session())));
  wire::ToProto(removal, response);
  return absl::OkStatus();
}

}  // namespace cairn::server
