#include "server/rpc/calls.h"
#include "wire/convert_alignment.h"

namespace cairn::server {

absl::Status AlignMap(const CallContext& context, const v1::AlignMapRequest& request, v1::AlignMapResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const api::AlignRequest asked, wire::FromProto(request));
  CAIRN_ASSIGN_OR_RETURN(const api::AlignAnswer answer, context.maps->Align(request.map(), asked));
  wire::ToProto(answer, response);
  return absl::OkStatus();
}

}  // namespace cairn::server
