#include "server/rpc/calls.h"
#include "wire/convert.h"

namespace cairn::server {

absl::Status CreateMap(const CallContext& context, const v1::CreateMapRequest& request,
                       v1::CreateMapResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const api::MapSummary created, context.maps->Create(request.map(), request.title()));
  wire::ToProto(created, response->mutable_summary());
  return absl::OkStatus();
}

}  // namespace cairn::server
