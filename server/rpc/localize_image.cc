#include "server/rpc/calls.h"
#include "server/rpc/images.h"
#include "wire/convert.h"

namespace cairn::server {

absl::Status LocalizeImage(const CallContext& context, const v1::LocalizeImageRequest& request,
                           v1::LocalizeImageResponse* response) {
  CAIRN_RETURN_IF_ERROR(api::CheckMapName(request.map()));
  api::LocalizeQuery query;
  CAIRN_ASSIGN_OR_RETURN(query.camera, wire::FromProto(request.camera()));
  CAIRN_RETURN_IF_ERROR(ReadContent(request, context.images, &query));
  query.time_ns = request.time_ns();
  if (request.has_prior()) {
    CAIRN_ASSIGN_OR_RETURN(query.prior, wire::FromProto(request.prior()));
  }
  CAIRN_ASSIGN_OR_RETURN(const api::LocalizeAnswer answer, context.maps->Localize(request.map(), query));
  if (context.observer != nullptr) context.observer->OnLocalized(answer);
  wire::ToProto(answer, response);
  return absl::OkStatus();
}

}  // namespace cairn::server
