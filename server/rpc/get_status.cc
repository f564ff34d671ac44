#include "server/rpc/calls.h"
#include "wire/convert_status.h"

namespace cairn::server {

absl::Status GetStatus(const CallContext& context, const v1::GetStatusRequest& /*request*/,
                       v1::GetStatusResponse* response) {
  // It names maps and sessions: who may read all of them may read it.
  if (context.access != nullptr) {
    CAIRN_RETURN_IF_ERROR(context.access->Require(*context.client, Right::kRead, "*"));
  }
  if (context.status == nullptr) return absl::UnimplementedError("this server does not count what it does");
  wire::ToProto(context.status->Status(), response);
  return absl::OkStatus();
}

}  // namespace cairn::server
