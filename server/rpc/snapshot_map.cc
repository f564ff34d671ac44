#include "server/rpc/calls.h"
#include "wire/convert.h"

namespace cairn::server {

absl::Status SnapshotMap(const CallContext& context, const v1::SnapshotMapRequest& request,
                         v1::SnapshotMapResponse* response) {
  CAIRN_ASSIGN_OR_RETURN(const api::MapSummary copy, context.maps->Snapshot(request.map(), request.as()));
  wire::ToProto(copy, response->mutable_summary());
  return absl::OkStatus();
}

}  // namespace cairn::server
