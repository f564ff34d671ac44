#include "server/rpc/calls.h"
#include "wire/convert_admin.h"

namespace cairn::server {

absl::Status ExportMap(const CallContext& context, const v1::ExportMapRequest& request, const ExportWriter& write) {
  CAIRN_ASSIGN_OR_RETURN(const api::ExportContent content, wire::Read(request.content()));
  return context.maps->Export(request.map(), content, [&](absl::string_view part) -> absl::Status {
    v1::ExportMapResponse response;
    response.set_part(std::string(part));
    return write(response) ? absl::OkStatus() : absl::CancelledError("the client went away");
  });
}

}  // namespace cairn::server
