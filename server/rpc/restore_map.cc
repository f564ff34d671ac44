#include "server/rpc/calls.h"

namespace cairn::server {

absl::Status RestoreMap(const CallContext& context, const v1::RestoreMapRequest& request,
                        v1::RestoreMapResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(*response->mutable_map(), context.maps->Restore(request.deleted(), request.as()));
  return absl::OkStatus();
}

}  // namespace cairn::server
