#include "server/rpc/calls.h"
#include "wire/convert.h"

namespace cairn::server {

absl::Status ListMaps(const CallContext& context, const v1::ListMapsRequest& /*request*/,
                      v1::ListMapsResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<api::MapSummary> maps, context.maps->List());
  for (const api::MapSummary& map : maps) wire::ToProto(map, response->add_maps());
  return absl::OkStatus();
}

}  // namespace cairn::server
