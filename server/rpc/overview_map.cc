#include "server/rpc/calls.h"
#include "wire/convert_overview.h"

namespace cairn::server {

absl::Status OverviewMap(const CallContext& context, const v1::OverviewMapRequest& request,
                         v1::OverviewMapResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const map::MapOverview map, context.maps->Overview(request.map()));
  wire::ToProto(map, response);
  return absl::OkStatus();
}

}  // namespace cairn::server
