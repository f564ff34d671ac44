#include "server/rpc/calls.h"
#include "wire/convert.h"

namespace cairn::server {

absl::Status DescribeMap(const CallContext& context, const v1::DescribeMapRequest& request,
                         v1::DescribeMapResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const api::MapDescription map, context.maps->Describe(request.map()));
  wire::ToProto(map, response);
  return absl::OkStatus();
}

}  // namespace cairn::server
