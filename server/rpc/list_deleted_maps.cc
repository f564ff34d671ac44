#include "server/rpc/calls.h"
#include "wire/convert_admin.h"

namespace cairn::server {

absl::Status ListDeletedMaps(const CallContext& context, const v1::ListDeletedMapsRequest& /*request*/,
                             v1::ListDeletedMapsResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const std::vector<api::DeletedMap> maps, context.maps->ListDeleted());
  for (const api::DeletedMap& map : maps) wire::ToProto(map, response->add_maps());
  return absl::OkStatus();
}

}  // namespace cairn::server
