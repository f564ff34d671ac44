#include "server/rpc/calls.h"
#include "wire/convert_admin.h"

namespace cairn::server {

absl::Status ReadLog(const CallContext& context, const v1::ReadLogRequest& request, v1::ReadLogResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const map::ChangeQuery query, wire::FromProto(request));
  CAIRN_ASSIGN_OR_RETURN(const api::MapLog log, context.maps->Log(request.map(), query));
  wire::ToProto(log, response);
  return absl::OkStatus();
}

}  // namespace cairn::server
