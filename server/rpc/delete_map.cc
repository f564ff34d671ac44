#include "server/rpc/calls.h"

namespace cairn::server {

absl::Status DeleteMap(const CallContext& context, const v1::DeleteMapRequest& request,
                       v1::DeleteMapResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(*response->mutable_deleted(), context.maps->Delete(request.map()));
  return absl::OkStatus();
}

}  // namespace cairn::server
