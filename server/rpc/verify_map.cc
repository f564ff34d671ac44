#include "server/rpc/calls.h"
#include "wire/convert_admin.h"

namespace cairn::server {

absl::Status VerifyMap(const CallContext& context, const v1::VerifyMapRequest& request,
                       v1::VerifyMapResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(
      const api::MapVerification verified,
      context.maps->Verify(request.map(), request.deep() ? api::VerifyDepth::kDeep : api::VerifyDepth::kStored));
  wire::ToProto(verified, response);
  return absl::OkStatus();
}

}  // namespace cairn::server
